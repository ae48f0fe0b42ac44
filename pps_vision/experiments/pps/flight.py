"""An arm that flees an approaching object, without rendering: what a robot that errs perceives and does."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from control import avoidance
from control.avoidance import AvoidanceParams, AvoidanceState
from control.fixation import gaze_at
from learning.memory import PPSMemory, activation
from learning.receptive_field import ReceptiveField, perceive
from pps_vision.app.encounter import REACH_M, STEP_S, at_taxel
from pps_vision.app.in_view import can_follow
from pps_vision.experiments.pps.errors import Belief
from pps_vision.robot.icub import HOME_ARM_RAD, home
from pps_vision.robot.skin import Skin, touched_taxels
from pps_vision.types import Array, Mask
from rendering.motions import Approach, make_approach


@dataclass(frozen=True)
class Flight:
    """What came of an approach: whether the skin was touched, and how long before the would-be touch the arm was
    first told to move (NaN: never)."""

    touched: bool
    moved_before_s: float


@dataclass(frozen=True)
class Fleeing:
    """A robot with its true skin, what it believes itself to be, and what its skin remembers."""

    belief: Belief
    skin: Skin
    memory: PPSMemory
    track_m: float = 0.0
    track_m_s: float = 0.0
    """Standard deviations of the tracker's position and velocity, each axis."""
    field: ReceptiveField = ReceptiveField()
    params: AvoidanceParams = AvoidanceParams(HOME_ARM_RAD)

    @cached_property
    def _of_arm(self) -> tuple[Skin, Mask]:
        """The believed taxels of the arm that moves, and which of all they are."""
        arm = Skin(tuple(part for part in self.belief.skin.parts if part.name.startswith(self.params.side)))
        return arm, np.isin(self.belief.skin.taxel_ids, arm.taxel_ids)

    def approach(self, taxel: str, radius_m: float, speed_m_s: float, rng: np.random.Generator) -> Approach:
        """A random path that surely touches the arm at home; it stops there (`app/encounter.py`)."""
        robot = self.belief.true_robot
        at_home = robot.at(home(robot))
        positions = self.skin.at(at_home)[0]
        aim = at_taxel(self.skin, at_home, self.skin.index(taxel), radius_m + REACH_M["approach"])
        for _ in range(200):
            motion = make_approach(rng, aim, speed_m_s)
            begins_touching = touched_taxels(positions, motion.start, radius_m).any()
            if not begins_touching and can_follow(robot, self.belief.true_rig, at_home.q_rad, motion, motion.contact_s):
                return motion
        raise ValueError(f"no approach to {taxel} stays in view; expected a taxel that the home posture shows")

    def meet(self, motion: Approach, radius_m: float, rng: np.random.Generator) -> Flight:
        """The arm from home, up to when the object begins to withdraw."""
        robot, slack = self.belief.true_robot, self.belief.slack(rng)
        q = gaze_at(robot, home(robot), 0.5 * (motion.start + motion.end))
        state, moved_s = AvoidanceState(), np.nan
        before = self.belief.skin.at(self.belief.robot.at(self.belief.joints(q, slack)))[0]
        for t in np.arange(0.0, motion.contact_s + motion.dwell_s, STEP_S):
            p, v = motion(t)
            if touched_taxels(self.skin.at(robot.at(q))[0], p, radius_m).any():
                return Flight(True, motion.contact_s - moved_s)
            posture = self.belief.robot.at(self.belief.joints(q, slack))
            seen_p, seen_v = (a[0] for a in self.belief.locate(p[None], v[None], q[None], slack, sees=True))
            seen_p = seen_p + self.track_m * rng.standard_normal(3)
            seen_v = seen_v + self.track_m_s * rng.standard_normal(3)
            positions, normals = self.belief.skin.at(posture)
            felt = self._activations(positions, normals, seen_p, seen_v, (positions - before) / STEP_S)
            before = positions
            arm, of_arm = self._of_arm
            state, command, _ = avoidance.step(self.params, state, posture, arm, felt[of_arm], float(t))
            if np.isnan(moved_s) and state.mode == "avoid":
                moved_s = float(t)
            q = robot.clamp(q + STEP_S * command.dq_rad_s)
        return Flight(False, motion.contact_s - moved_s)

    def _activations(self, positions: Array, normals: Array, p: Array, v: Array, moving: Array) -> Array:
        """As the pipeline does: the sooner of what the object does to a taxel at rest and as it moves."""
        cov = self.track_m_s**2 * np.eye(3)
        D, at_rest = perceive(self.field, positions, normals, p, v, cov_v=cov)
        _, as_moves = perceive(self.field, positions, normals, p, v, cov_v=cov, taxel_velocities_root=moving)
        both = (at_rest >= 0) & (as_moves >= 0)
        ttc = np.where(both, np.minimum(at_rest, as_moves), np.where(at_rest >= 0, at_rest, as_moves))
        return activation(self.memory, D, ttc)

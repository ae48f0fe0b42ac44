"""`pps-vision reach`: learn which fixated points a hand can reach, query the map, draw it."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg, subcommand

from learning.reach import MeasureName
from pps_vision.app.cli.options import RobotOptions
from pps_vision.errors import InputError
from tracking import Mode

if TYPE_CHECKING:
    from learning.reach.labels import HandModel
    from learning.reach.map import ReachableMap
    from learning.reach.params import MapParams
    from pps_vision.robot.robot_setup import RobotSetup

_TEST_POSTURES = 10_000  # for a map without --max-error: they bound an error of 0.02 % by 0.06 %
_LEAST_BUDGET = 200  # labels: with fewer, the test set is too small to bound the error


@dataclass(frozen=True)
class TrainMap(RobotOptions):
    """Learn the map of an arm, or of both arms at once, by inverse kinematics with the robot's own model; with --from,
    with kinematics learned from the hand that the eyes saw.

    Torso, neck roll, eye tilt, version and wrist at 0; the hand is the origin of the palm's frame; yaw, pitch and
    vergence within ±55, ±40 and 5–90°, the four arm joints within the limits of Jamone et al.; of another robot's arm
    all joints within the limits of its URDF.  With fixed cameras, gaze means the direction and vergence of a point.
    """

    arm: Literal["left", "right", "both"]
    """Arm, or both."""
    out: Path
    """Where to write the map (.npz)."""
    max_error: float = 0.0
    """Stop when a test by the same kinematics shows, with 95 % confidence, that at most this share of all gaze
    postures is misjudged."""
    ik_budget: int = 24_000
    """Largest number of inverse-kinematics problems per arm to learn from, tests not counted."""
    from_: Annotated[tuple[Path, ...], arg(name="from")] = ()
    """Recordings of the arm's motor babbling (`pps-vision session babbling`): its hand is tracked, and its kinematics
    learned from that.  Its first four joints move, the wrist is at rest."""
    mode: Mode = "marker"
    """How the hand is tracked in --from: marker (a green marker about it) or generic (whatever moves)."""
    end_point: str = "palm"
    """Point that reaches: palm, or a taxel of the arm, such as left_forearm:27."""
    measure: MeasureName = "joint-limits"
    """Measure of a posture: far from the joints' limits; hand velocities large for the joints' (manipulability) or
    the same in all directions (isotropy: far from singularities); or from how many sides the skin can approach."""
    into: Path | None = None
    """An earlier map of the same arm to continue from."""
    seed: int = 0
    """Seed of the sampled postures."""

    def run(self) -> None:
        from learning.reach.map import ReachableMap, both
        from learning.reach.params import MapParams
        from pps_vision.app.progress import progress
        from pps_vision.recordings.atomic_write import whole_file

        if self.arm == "both" and self.into is not None:
            raise InputError("reach train", f"--into {self.into} with --arm both; expected --into with one arm")
        if self.ik_budget < _LEAST_BUDGET:
            raise InputError("reach train", f"--ik-budget {self.ik_budget}; expected at least {_LEAST_BUDGET}")
        if not 0 <= self.max_error < 1:
            raise InputError("reach train", f"--max-error {self.max_error}; expected a share of at least 0 and below 1")
        sides = ("left", "right") if self.arm == "both" else (self.arm,)
        rounds = min(MapParams().round_labels, self.ik_budget // 2)
        params = replace(
            MapParams(),
            n_labels=self.ik_budget,
            round_labels=rounds,
            max_error=self.max_error / len(sides),  # the errors and the risks of both hands add up
            n_test=0 if self.max_error else _TEST_POSTURES,
            confidence=1 - 0.05 / len(sides),
        )
        if self.from_ and (self.arm == "both" or self.end_point != "palm" or self.measure == "approach"):
            problem = f"--from with --arm {self.arm}, --end-point {self.end_point}, --measure {self.measure}"
            raise InputError("reach train", f"{problem}; expected one arm, the palm, and a measure of its postures")
        setup = self.setup()
        with whole_file(self.out, [self.into, *self.from_, *self.files]) as partial:
            into = ReachableMap.load(self.into) if self.into else None
            if into and self.into:
                options = (self.arm, self.end_point, self.measure, self._kinematics, MapParams().gaze_limits)
                values = (into.side, into.end_point, into.measure, into.kinematics, into.limits)
                for option, value in zip(options, values, strict=True):
                    if option != value:
                        raise InputError(self.into, f"is a map of {value}; expected one of {option} to continue from")
            maps = [
                self._learn(setup, side, params, into) for side in progress(sides, desc="reachable space", unit="arm")
            ]
            learned = both(*maps) if len(maps) == 2 else maps[0]
            learned.save(partial)
        n_problems = sum(len(arm_map.labels.gaze_rad) + arm_map.unanswered for arm_map in maps)
        print(
            f"{n_problems} inverse-kinematics problems by {learned.kinematics}, "
            f"{learned.unanswered} without an answer, "
            f"at most {100 * learned.error_bound:.2g} % misjudged, with 95 % confidence → {self.out}"
        )
        if learned.error_bound > self.max_error > 0:
            print(f"--max-error {self.max_error} was not reached within --ik-budget {self.ik_budget}")

    @property
    def _kinematics(self) -> str:
        from learning.reach.map import OWN_MODEL

        return f"the hand seen in {', '.join(map(str, self.from_))}" if self.from_ else OWN_MODEL

    def _seen(self, setup: "RobotSetup", side: str) -> "HandModel":
        """The hand as the eyes saw it."""
        from learning.reach.labels import HandModel
        from pps_vision.app.learn import seen_hand
        from pps_vision.app.progress import progress
        from pps_vision.recordings.open import open_recording

        recordings = [open_recording(path, robot=setup) for path in self.from_]
        tracked = progress(recordings, desc="tracked", unit="recording")
        seen = seen_hand(tracked, setup.robot, side, self.mode, self.seed)
        print(f"hand seen in {len(seen.arm_rad)} of {sum(map(len, recordings))} frames")
        return HandModel.seen(setup.robot, side, seen)

    def _learn(
        self, setup: "RobotSetup", side: str, params: "MapParams", into: "ReachableMap | None"
    ) -> "ReachableMap":
        import numpy as np

        from learning.reach.labels import hand_and_params
        from learning.reach.params import ArmLimits
        from learning.reach.training import train_reachable_map

        robot = setup.robot
        if self.robot is not None:
            if not robot.names.arm(side):
                raise InputError(self.robot, f"has no {side}_arm; expected --arm {setup.side}")
            params = replace(params, arm_limits=ArmLimits.of(robot, side))
        hand, params = hand_and_params(robot, side, self.end_point, self.measure, params, setup.skin)
        if self.from_:
            hand = self._seen(setup, side)
        learned = train_reachable_map(robot, side, np.random.default_rng(self.seed), params, hand, into)
        return replace(learned, end_point=self.end_point, measure=self.measure, kinematics=self._kinematics)


@dataclass(frozen=True)
class QueryMap:
    """Query a map for gaze postures; outside its limits the verdict is 0, and probability and degree are empty."""

    map: Positional[Path]
    """The map (.npz)."""
    gaze: Positional[Path]
    """CSV with yaw_deg, pitch_deg and vergence_deg."""
    out: Path
    """CSV to write: the same with reachable, probability and degree."""
    max_fp: float | None = None
    """Largest share of unreachable postures that are called reachable; default: probability above one half."""
    device: str | None = None
    """Compute with torch on this device (cpu, cuda, cuda:1), for very many postures; default: without torch."""

    def run(self) -> None:
        import numpy as np

        from learning.reach.map import ReachableMap
        from pps_vision.app.track import torch_device
        from pps_vision.recordings.atomic_write import whole_file
        from pps_vision.recordings.tables import read_gaze, write_reachability

        with whole_file(self.out, [self.map, self.gaze]) as partial:
            device = None if self.device is None else str(torch_device(self.device))
            reachable_map = ReachableMap.load(self.map)
            gaze = read_gaze(self.gaze)
            threshold = 0.5 if self.max_fp is None else reachable_map.threshold(self.max_fp)
            verdict = reachable_map.query(gaze, threshold, device)
            columns = (*np.rad2deg(gaze).T, verdict.reachable, verdict.probability, verdict.degree)
            write_reachability(partial, zip(*columns, strict=True))
        outside = int((~verdict.within_limits).sum())
        print(f"{int(verdict.reachable.sum())} of {len(gaze)} reachable, {outside} outside the map → {self.out}")


@dataclass(frozen=True)
class ShowMap(RobotOptions):
    """Draw a map: the degree of reachability over yaw and pitch at several vergences."""

    map: Positional[Path]
    """The map (.npz)."""
    out: Path
    """The figure to write (.png, .svg or .pdf)."""

    def run(self) -> None:
        from learning.reach.map import ReachableMap
        from pps_vision.app.report import figures
        from pps_vision.app.report.page import save
        from pps_vision.recordings.atomic_write import whole_file

        with whole_file(self.out, [self.map, *self.files]) as partial:
            reachable_map = ReachableMap.load(self.map)
            save(figures.reachable_space(reachable_map, self.setup().robot), partial)
        print(f"{reachable_map.side} arm, {reachable_map.end_point}, by {reachable_map.kinematics} → {self.out}")


@dataclass(frozen=True)
class Reach:
    """Learn, query or draw which fixated points a hand can reach."""

    subcommand: (
        Annotated[TrainMap, subcommand("train")]
        | Annotated[QueryMap, subcommand("query")]
        | Annotated[ShowMap, subcommand("show")]
    )

    def run(self) -> None:
        self.subcommand.run()

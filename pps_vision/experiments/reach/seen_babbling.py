"""Motor babbling through the rendered eyes: how well the seen hand is fixated, and what that teaches (J, IV B, C)."""

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.babbling import ArmToGaze, Babbled, babble, gaze_at_hand, random_arms, score
from learning.gaussian_process import GaussianProcess
from learning.regressors import LocalModels
from learning.turning_joints import TurningJoints
from pps_vision.experiments.chart import panels
from pps_vision.experiments.reach.forward_model import LWPR_OF_THE_ARM, Model
from pps_vision.experiments.reach.onlooker import Looked, Onlooker, OnlookerParams
from pps_vision.robot.icub import icub_rig, load_icub, set_gaze
from pps_vision.robot.model import Robot
from pps_vision.types import Array
from rendering.eyes import Eyes
from rendering.fidelity import Fidelity
from rendering.scene import SceneState
from rendering.sensor import Sensor
from rendering.shapes import disc
from rendering.stimuli import GREEN, Stimulus, make_stimulus
from tracking.marker import MarkerParams

SENSOR, FIDELITY = Sensor(noise_sigma=2.0), Fidelity(fineness=2)
_SIDE, _PALM = "right", "right_palm"
_GOAL_DEG, _N_TEST = 0.3, 700
_EDGE_ON_RAD = np.deg2rad(75)
_ANGLES = ("yaw", "pitch", "vergence")
_MAIN = "green ball for a hand"


@dataclass(frozen=True)
class Hand:
    """What is green: a stimulus at the palm frame's origin, whether the hand is drawn around it, whether it is flat."""

    stimulus: Stimulus
    drawn: bool
    flat: bool = False


HANDS = {
    _MAIN: Hand(make_stimulus("marker", 0.02), drawn=False),
    "ball in the drawn hand": Hand(make_stimulus("marker", 0.04), drawn=True),
    "patch on the palm": Hand(Stimulus("marker", 0.015, (disc(0.015, GREEN),)), drawn=True, flat=True),
}


@dataclass(frozen=True)
class SeenBabbling:
    """Random arm postures whose green hand is found, tracked and fixated in rendered images, against kinematics.

    Green is, as in J, the whole hand: a ball about the palm frame's origin, so that what is seen is the hand's
    definition from all sides.  Beside it, on fewer postures, a ball with the hand drawn around it and a patch on the
    palm, which the hand hides.  Both eyes look with noise of 2 grey levels.
    """

    seed: int = 0
    """Seed of the postures, the looks and the noise."""
    n: int = 330
    """Postures that by kinematics can be fixated, shown with the ball."""
    n_others: int = 40
    """Of these, shown with each of the others; and as many that cannot be fixated, with the ball."""

    def run(self) -> dict[str, Any]:
        """By hand: outcomes, causes of failures, gaze errors (degrees); of the first, what it teaches."""
        if not (self.n >= 20 and 1 <= self.n_others <= self.n):
            raise ValueError(
                f"bench reach seen_babbling: --n {self.n}, --n-others {self.n_others}; expected 20 at least and 1 to n"
            )
        robot, rng = load_icub(), np.random.default_rng(self.seed)
        arms = random_arms(10 * self.n, rng)
        gaze = gaze_at_hand(robot, _SIDE, arms)
        can = np.isfinite(gaze).all(axis=1)
        able, unable = arms[can], arms[~can]
        begun = time.process_time()
        hands, seen = {}, np.zeros((0, 3))
        for name, hand in HANDS.items():
            n = self.n if name == _MAIN else self.n_others
            more = unable[: self.n_others] if name == _MAIN else unable[:0]
            with Watching(robot, hand, self.seed) as watching:
                looked = [watching.at(arm) for arm in tqdm(able[:n], desc=name, unit="posture", disable=None)]
                beyond = [watching.at(arm) for arm in tqdm(more, desc="beyond the limits", disable=None)]
                hands[name] = judged(watching, looked, able[:n], gaze[can][:n])
            if name == _MAIN:
                seen, unreached = np.array([one.gaze_rad for one in looked]), Counter(one.outcome for one in beyond)
        return {
            "goal_deg": _GOAL_DEG,
            "can_be_fixated_percent": 100 * float(can.mean()),
            "hands": hands,
            "beyond_the_limits": {"shown": self.n_others, **unreached},
            "learned": _taught(robot, able[: self.n], seen, gaze[can][: self.n], self.seed),
            "processor_s": time.process_time() - begun,
        }

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """What became of the postures and how far off the gaze is; and what is learned from how many."""
        return {"": _fixation_chart(numbers), "learned": _learning_chart(numbers)}


class Watching:
    """A robot that watches its own hand; use as a context manager.  The eyes stay where they last looked."""

    def __init__(self, robot: Robot, hand: Hand, seed: int) -> None:
        rig = icub_rig(robot)
        undrawn = () if hand.drawn else (_PALM,)
        self.robot, self.hand = robot, hand
        self._eyes = Eyes(robot, rig, hand.stimulus, sensor=SENSOR, fidelity=FIDELITY, undrawn=undrawn)
        self._onlooker = Onlooker(robot, rig, self._eyes, MarkerParams(), np.random.default_rng((seed, 1)))
        self._joints = robot.indices(robot.names.arm(_SIDE)[:4])
        yaw, pitch, tilt, vergence = OnlookerParams().ahead_rad
        self._q = set_gaze(robot, np.zeros(robot.n_joints), yaw, pitch, tilt, 0.0, vergence)

    def __enter__(self) -> "Watching":
        """Itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Give the graphics memory back."""
        self._eyes.__exit__(None, None, None)

    def at(self, arm_rad: Array) -> Looked:
        """Fixate the hand of an arm posture (4,)."""
        q = self._with(arm_rad)
        palm = self.robot.at(q).T_root(_PALM)
        looked = self._onlooker.fixate(q, palm[:3, 3], palm[:3, :3])
        self._q = looked.q_rad
        return looked

    def cause(self, looked: Looked, arm_rad: Array, gaze_rad: Array) -> str:
        """Why a hand that by kinematics is fixated by `gaze_rad` was not, or not rightly: what only the scene knows."""
        yaw, pitch, vergence = gaze_rad
        q = set_gaze(self.robot, self._with(arm_rad), yaw, pitch, 0.0, 0.0, vergence)
        posture = self.robot.at(q)
        palm = posture.T_root(_PALM)
        middle = 0.5 * (posture.point(self.robot.names.left_eye) + posture.point(self.robot.names.right_eye))
        way = middle - palm[:3, 3]
        tilted = np.arccos(np.clip(palm[:3, 2] @ way / np.linalg.norm(way), -1, 1))
        if self.hand.flat and tilted > np.pi / 2:
            return "turned away"
        if self.hand.flat and tilted > _EDGE_ON_RAD:
            return "seen edge-on"
        truth = self._eyes.truth(SceneState(q, palm[:3, 3], rotation=palm[:3, :3]), 0.0)
        if not (truth.visible_left and truth.visible_right):
            return "hidden"
        return "partly hidden" if looked.outcome in ("fixated", "eyes disagree") else looked.outcome

    def _with(self, arm_rad: Array) -> Array:
        q = self._q.copy()
        q[self._joints] = arm_rad
        return q


def judged(watching: Watching, looked: list[Looked], arms: Array, gaze: Array) -> dict[str, Any]:
    """Of postures that by kinematics can be fixated (`gaze`, rad): nothing is left out but what was not fixated."""
    error = np.rad2deg(np.array([one.gaze_rad for one in looked]) - gaze)
    fixated = np.isfinite(error).all(axis=1)
    good = fixated & (np.abs(error).max(axis=1, initial=0) <= _GOAL_DEG)
    wrong = Counter(watching.cause(looked[k], arms[k], gaze[k]) for k in np.flatnonzero(fixated & ~good))
    failed = Counter(watching.cause(looked[k], arms[k], gaze[k]) for k in np.flatnonzero(~fixated))
    error = error[fixated]
    return {
        "shown": len(looked),
        "fixated": int(fixated.sum()),
        "within_goal": int(good.sum()),
        "beyond_goal_by_cause": dict(wrong),
        "not_fixated_by_cause": dict(failed),
        "rmse_deg": by_angle(np.sqrt(np.mean(error**2, axis=0))),
        "median_deg": by_angle(np.median(np.abs(error), axis=0)),
        "worst_deg": by_angle(np.abs(error).max(axis=0, initial=0)),
        "frames": float(np.mean([one.frames for one in looked])),
        "looks": float(np.mean([one.looks for one in looked])),
        "largest_errors_deg": np.sort(np.abs(error).max(axis=1)).round(4).tolist(),
    }


def by_angle(values: Array) -> dict[str, float]:
    """Three values by the name of the gaze angle."""
    return dict(zip(_ANGLES, values.tolist(), strict=True))


def _taught(robot: Robot, arms: Array, seen: Array, true: Array, seed: int) -> dict[str, Any]:
    """RMSE (degrees) against true kinematics, on postures never shown, over the number of samples; seen and not."""
    fixated = np.isfinite(seen).all(axis=1)
    arms, gaze = arms[fixated], {"seen": seen[fixated], "by kinematics": true[fixated]}
    test = babble(robot, _SIDE, 5 * _N_TEST, np.random.default_rng((seed, 2)))
    test = Babbled(test.arm_rad[:_N_TEST], test.gaze_rad[:_N_TEST], test.n_tried)
    sizes = sorted({n for n in (20, 40, 80, 160) if n < len(arms)} | {len(arms)})
    makers: dict[str, Callable[[], Model]] = {
        "turning joints": TurningJoints,
        "Gaussian process": lambda: ArmToGaze(GaussianProcess()),
        "LWPR": lambda: ArmToGaze(LocalModels(4, 3, LWPR_OF_THE_ARM)),
    }
    curves = {}
    for method, make in makers.items():
        for source, target in gaze.items():
            model, scores, before = make(), [], 0
            for n in sizes:
                model.learn(arms[before:n], target[before:n])
                scores.append(score(model, test))
                before = n
            rmse, unanswered = (list(column) for column in zip(*scores, strict=True))
            curves[f"{method}, {source}"] = {"rmse_deg": rmse, "unanswered": unanswered}
    return {"samples": sizes, "curves": curves}


def _fixation_chart(numbers: dict[str, Any]) -> Figure:
    figure, (became, errors) = panels(2, 5.6, 3.6)
    names = list(numbers["hands"])
    causes = sorted({c for hand in numbers["hands"].values() for c in hand["not_fixated_by_cause"]})
    kinds = {"within 0.3° of kinematics": "C0", "farther off": "C1"}
    kinds |= {f"not fixated: {cause}": str(shade) for cause, shade in zip(causes, _shades(len(causes)), strict=True)}
    left = np.zeros(len(names))
    for kind, color in kinds.items():
        share = np.array([_share(numbers["hands"][name], kind) for name in names])
        became.barh(names, share, left=left, color=color, label=kind)
        left += share
    became.invert_yaxis()
    became.set_xlabel("postures that kinematics can fixate (%)")
    became.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.4, -0.22), ncols=2)
    for k, name in enumerate(names):
        hand = numbers["hands"][name]
        error = np.maximum(hand["largest_errors_deg"], 1e-3)
        share = 100 * np.arange(1, len(error) + 1) / hand["shown"]
        errors.step(error, share, where="post", color=("C2", "C4", "C5")[k], label=f"{name}, {hand['shown']} shown")
    errors.axvline(numbers["goal_deg"], color="0.4", ls="--", lw=0.8)
    errors.annotate("goal, as RMSE ", (numbers["goal_deg"], 70), fontsize=7, ha="right")
    errors.set(xscale="log", ylim=(0, 100), xlabel="largest error of a gaze angle (°)", ylabel="postures within (%)")
    errors.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.22))
    errors.grid(alpha=0.25)
    figure.suptitle(
        "Fixating the seen hand finds the gaze that kinematics knows, where the hand can be seen", fontsize=10
    )
    return figure


def _shades(n: int) -> Array:
    return np.linspace(0.35, 0.85, max(n, 1))[:n].round(2)


def _share(hand: dict[str, Any], kind: str) -> float:
    if kind.startswith("within"):
        count = hand["within_goal"]
    elif kind.startswith("farther"):
        count = hand["fixated"] - hand["within_goal"]
    else:
        count = hand["not_fixated_by_cause"].get(kind.removeprefix("not fixated: "), 0)
    return 100 * float(count) / float(hand["shown"])


def _learning_chart(numbers: dict[str, Any]) -> Figure:
    figure, (axis,) = panels(1, 6.4, 4.4)
    samples = np.array(numbers["learned"]["samples"])
    for k, (name, curve) in enumerate(numbers["learned"]["curves"].items()):
        error = np.array(curve["rmse_deg"], dtype=float)
        axis.plot(samples, error, "--o" if "kinematics" in name else "-o", color=f"C{k // 2}", ms=5, label=name)
        partly = np.array(curve["unanswered"]) > 0.01
        axis.plot(samples[partly], error[partly], "o", ms=5, mec=f"C{k // 2}", mfc="white", zorder=3)
    axis.plot([], [], "o", ms=5, mec="0.4", mfc="white", label="no answer to more than 1 %")
    _goal(axis, numbers["goal_deg"])
    axis.set(xscale="log", yscale="log", xticks=samples, xlabel="arm postures whose hand was fixated")
    axis.xaxis.set_major_formatter("{x:g}")
    axis.xaxis.set_minor_formatter("")
    axis.yaxis.set_major_formatter("{x:g}")
    axis.yaxis.set_minor_formatter("")
    axis.set_ylabel(f"gaze RMSE on {_N_TEST} others (°), against kinematics")
    axis.set_title("What seeing the hand teaches of arm → gaze (J Fig 2)", fontsize=10)
    axis.legend(fontsize=8)
    axis.grid(alpha=0.25, which="both")
    return figure


def _goal(axis: Axes, goal_deg: float) -> None:
    axis.axhline(goal_deg, color="0.4", lw=0.8, ls="--")
    axis.annotate("goal, through vision", (20, goal_deg), va="bottom", fontsize=7)

"""Objects out of reach, brought into reach by turning the torso while the eyes stay on them, and touched.

By kinematics: the robot's joints obey, what is fixated is known.  How many of those that some torso posture could
bring into reach are; what fixation loses meanwhile, with the head turning along by the learned relation or only after
what it sees; and what the learned relation is worth against the true kinematics.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.reach.torso_gaze import TorsoFrame, TorsoToGaze, turn_torso
from pps_vision.experiments.chart import panels
from pps_vision.experiments.reach.planning_attempt import DT_S, Attempt, attempt
from pps_vision.experiments.reach.planning_world import GAZE, PlanningWorld, Truth
from pps_vision.experiments.study import Study
from pps_vision.robot.gaze import fixation_points, gaze_for_points
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Mask

_TOUCH_M, _HELD_RAD = 0.01, np.deg2rad(2.0)
_DEFAULT_TURNS = 600


@dataclass(frozen=True)
class Planning(Study):
    """The right hand's objects, in all directions and as many near as far, none within reach at first."""

    seed: int = 0
    """Seed of the learning and the objects."""
    n: int = 200
    """Objects."""
    n_labels: int = 12_000
    """Inverse-kinematics solutions the map is learned from."""
    turns: tuple[int, ...] = (30, 100, 300, _DEFAULT_TURNS, 1200)
    """Points the torso is turned about, for the learned relation's error."""

    def run(self) -> dict[str, Any]:
        """Counts, and quartiles over what was brought into reach; the error of the learned relation."""
        if self.n < 1:
            raise ValueError(f"bench reach planning: --n {self.n}; expected at least 1")
        world = PlanningWorld.make(self.seed, self.n_labels)
        truth, rng = Truth(world.robot), np.random.default_rng(self.seed + 1_000_000)
        points = truth.unreachable(self.n, rng)
        least = np.array([truth.least_turn(point) for point in points])
        attempts = [attempt(world, point) for point in tqdm(points, desc="objects", disable=None)]
        lagging = [attempt(world, point, leads=False) for point in points[np.isfinite(least)][: self.n // 8]]
        touched = np.array([a.palm_off_m <= _TOUCH_M for a in attempts])
        brought = [a for a, t in zip(attempts, touched, strict=True) if t]
        shown = max(brought, key=lambda a: a.turned_rad, default=attempts[0])
        return {
            "objects": self.n,
            **_counts(attempts, touched, np.isfinite(least)),
            **_spreads(brought),
            "turned_over_least": _spread(
                [a.turned_rad / turn for a, turn, t in zip(attempts, least, touched, strict=True) if t]
            ),
            "worst_fixation_error_without_the_relation_deg": _spread(
                [np.rad2deg(a.fixation_rad) for a in lagging if a.palm_off_m <= _TOUCH_M]
            ),
            "beyond_joint_limits_deg": float(np.rad2deg(max(a.beyond_limits_rad for a in attempts))),
            "fastest_joint_deg_s": float(np.rad2deg(max(a.fastest_rad_s for a in attempts))),
            "relation": relation_errors(world.robot, self.seed, self.turns),
            "each": {
                "least_turn_deg": [float(np.rad2deg(t)) if np.isfinite(t) else None for t in least],
                "turned_deg": [float(np.rad2deg(a.turned_rad)) for a in attempts],
                "touched": touched.tolist(),
            },
            "shown": shown.trace.round(5).tolist(),
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """One object's way; how far the torso turned against how far it had to; the learned relation's error."""
        figure, (way, length, relation) = panels(3, 4.6)
        _draw_way(way, np.array(numbers["shown"]))
        each = numbers["each"]
        for said, name, color in ((True, "touched", "C2"), (False, "not touched", "C3")):
            rows = [
                (least, turned)
                for least, turned, t in zip(each["least_turn_deg"], each["turned_deg"], each["touched"], strict=True)
                if t == said and least is not None
            ]
            length.plot(*np.array(rows).reshape(-1, 2).T, "o", ms=4, alpha=0.6, color=color, label=name)
        top = max([t for t in each["turned_deg"] if t is not None] + [10.0])
        length.plot([0, top], [0, top], "--", color="0.4", lw=1, label="no farther than it had to")
        n, can = numbers["objects"], numbers["within_reach_of_some_torso_posture"]
        length.set(xlabel="least turn of the torso that will do (°)", ylabel="turn made, all told (°)")
        length.set_title(f"{numbers['touched']} touched of {can} that can be, of {n} objects", fontsize=9)
        length.legend(fontsize=8)
        rows = numbers["relation"]
        relation.loglog([r["turns"] for r in rows], [r["rms_deg"] for r in rows], "o-", label="RMS")
        relation.loglog([r["turns"] for r in rows], [r["p95_deg"] for r in rows], "s-", label="95 %")
        relation.loglog(
            [r["turns"] for r in rows],
            [r["no_relation_rms_deg"] for r in rows],
            ":",
            color="0.4",
            label="RMS, gaze kept still",
        )
        default = [r for r in rows if r["turns"] == _DEFAULT_TURNS]
        relation.plot([r["turns"] for r in default], [r["rms_deg"] for r in default], "o", ms=11, mfc="none", mec="0.2")
        relation.set(xlabel="points the torso was turned about", ylabel="gaze error after a turn of 1° (°)")
        relation.set_title("learned relation of torso to gaze (default ringed)", fontsize=9)
        relation.legend(fontsize=8)
        for axis in (length, relation):
            axis.grid(alpha=0.25, which="both")
        return figure


def _counts(attempts: list[Attempt], touched: Mask, can: Mask) -> dict[str, Any]:
    """What became of the objects that some torso posture brings into reach, and of the others."""
    refused = np.array([a.said == "out of reach" for a in attempts])
    there = np.array([a.said == "there" for a in attempts])
    return {
        "within_reach_of_some_torso_posture": int(can.sum()),
        "touched": int((touched & can).sum()),
        "touched_though_the_truths_grid_says_no": int((touched & ~can).sum()),
        "said_out_of_reach_rightly": int((refused & ~can).sum()),
        "said_out_of_reach_wrongly": int((refused & can).sum()),
        "said_there_and_not_touched": int((there & ~touched).sum()),
        "said_neither": int((~there & ~refused).sum()),
        "turned_though_hopeless_deg": _spread(
            [np.rad2deg(a.turned_rad) for a, c in zip(attempts, can, strict=True) if not c]
        ),
    }


def _spreads(brought: list[Attempt]) -> dict[str, Any]:
    """What it took to bring objects into reach."""
    return {
        "palm_off_mm": _spread([1000 * a.palm_off_m for a in brought]),
        "worst_fixation_error_deg": _spread([np.rad2deg(a.fixation_rad) for a in brought]),
        "held_within_2_deg": sum(a.fixation_rad <= _HELD_RAD for a in brought),
        "seconds": _spread([a.seconds for a in brought]),
        "turned_deg": _spread([np.rad2deg(a.turned_rad) for a in brought]),
    }


def relation_errors(robot: Robot, seed: int, sizes: tuple[int, ...], n_test: int = 500) -> list[dict[str, float]]:
    """By number of points turned about: how far the gaze expected after a turn of 1° is from the one that fixates."""
    rng = np.random.default_rng(seed + 2_000_000)
    test, frame = turn_torso(robot, n_test, rng, GAZE), TorsoFrame(robot)
    angle = rng.uniform(0, 2 * np.pi, len(test.gaze_rad))
    turns = np.deg2rad(1.0) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = frame.to_root(test.torso_rad, fixation_points(robot, test.gaze_rad))
    true = gaze_for_points(
        robot, frame.from_upright(test.torso_rad + turns, points), replace(GAZE, vergence_rad=(0.01, 2.0))
    )
    train = turn_torso(robot, 2 * max(sizes), np.random.default_rng(seed), GAZE)
    rows = []
    for n in sizes:
        relation = TorsoToGaze()
        relation.learn(
            replace(train, gaze_rad=train.gaze_rad[:n], torso_rad=train.torso_rad[:n], after_rad=train.after_rad[:n])
        )
        said = np.array(
            [relation(g, t, turn[None])[0] for g, t, turn in zip(test.gaze_rad, test.torso_rad, turns, strict=True)]
        )
        off = np.rad2deg(np.abs(said - true).max(axis=1))
        still = np.rad2deg(np.abs(test.gaze_rad - true).max(axis=1))
        known = np.isfinite(off)
        rows.append(
            {
                "turns": n,
                "rms_deg": float(np.sqrt(np.mean(off[known] ** 2))),
                "p95_deg": float(np.quantile(off[known], 0.95)),
                "median_deg": float(np.median(off[known])),
                "no_relation_rms_deg": float(np.sqrt(np.mean(still[known] ** 2))),
            }
        )
    return rows


def _spread(values: list[float]) -> dict[str, float] | None:
    if not values:
        return None
    median, p95, worst = np.quantile(values, (0.5, 0.95, 1.0))
    return {"median": float(median), "p95": float(p95), "worst": float(worst)}


def _draw_way(axis: Axes, trace: Array) -> None:
    t = DT_S * np.arange(len(trace))
    axis.plot(t, np.rad2deg(trace[:, 0]), label="torso yaw (°)")
    axis.plot(t, np.rad2deg(trace[:, 1]), label="torso pitch (°)")
    axis.plot(t, 10 * np.rad2deg(trace[:, 3]), color="C3", lw=1, label="fixation error (0.1°)")
    axis.set(xlabel="time (s)", ylabel="angle")
    axis.legend(fontsize=8, loc="lower left")
    axis.grid(alpha=0.25)
    degree = axis.twinx()
    degree.plot(t, trace[:, 2], color="0.3", ls="--", label="degree R")
    degree.axhline(0.5, color="0.6", lw=0.8)
    degree.set(ylim=(0, 1), ylabel="degree R (dashed; reachable above 0.5)")
    axis.set_title("the object that took the longest turn", fontsize=9)

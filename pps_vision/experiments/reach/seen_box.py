"""J's Cartesian test through the rendered eyes: a red ball anywhere in the box is fixated, and the map is asked."""

import time
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.reachable_training import MapParams, train_reachable_map
from pps_vision.experiments.chart import panels
from pps_vision.experiments.reach.map_test import BOX_HIGH, BOX_LOW, closed_form, rates
from pps_vision.experiments.reach.onlooker import Looked, Onlooker, OnlookerParams
from pps_vision.experiments.reach.seen_babbling import FIDELITY, SENSOR, by_angle
from pps_vision.robot.gaze import gaze_for_points
from pps_vision.robot.icub import icub_rig, load_icub, set_gaze
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Mask
from rendering.eyes import Eyes
from rendering.stimuli import make_stimulus
from tracking.marker import MarkerParams

_RED = MarkerParams(hue_deg=359.0)


@dataclass(frozen=True)
class SeenBox:
    """Locations of J's box with a red ball there: fixated in rendered images, and by kinematics; what the map says of
    either gaze, and whether the right hand gets there."""

    seed: int = 0
    """Seed of the locations, the map, the looks and the noise."""
    n: int = 200
    """Locations."""
    labels: int = 12_000
    """Inverse-kinematics solutions that the map is made from."""

    def run(self) -> dict[str, Any]:
        """Outcomes; gaze errors in degrees; verdicts of seen and of kinematic gaze against the truth, in percent."""
        if self.n < 10:
            raise ValueError(f"bench reach seen_box: --n {self.n}; expected 10 at least")
        robot = load_icub()
        params = MapParams(n_labels=self.labels, round_labels=min(MapParams().round_labels, self.labels // 2))
        learned = train_reachable_map(robot, "right", np.random.default_rng(self.seed), params)
        points = np.random.default_rng((self.seed, 1)).uniform(BOX_LOW, BOX_HIGH, (self.n, 3))
        true = np.isfinite(closed_form(robot).solve(points)[:, 0])
        by_kinematics = gaze_for_points(robot, points)
        begun = time.process_time()
        looked = _looked(robot, points, self.seed)
        seconds = time.process_time() - begun
        seen = np.array([one.gaze_rad for one in looked])
        can, did = _known(by_kinematics), _known(seen)
        both = can & did
        error = np.rad2deg(seen[both] - by_kinematics[both])
        said = [learned.query(gaze[both]).reachable for gaze in (seen, by_kinematics)]
        verdict = np.full(self.n, None)
        verdict[both] = [bool(one) for one in said[0]]
        return {
            "shown": self.n,
            "kinematics_can_fixate": int(can.sum()),
            "outcomes_where_it_can": Counter(one.outcome for one, ok in zip(looked, can, strict=True) if ok),
            "outcomes_where_it_cannot": Counter(one.outcome for one, ok in zip(looked, can, strict=True) if not ok),
            "fixated_both_ways": int(both.sum()),
            "of_them_reachable": int(true[both].sum()),
            "rmse_deg": by_angle(np.sqrt(np.mean(error**2, axis=0))),
            "worst_deg": float(np.abs(error).max(initial=0)),
            "seen_percent": rates(said[0], true[both]),
            "by_kinematics_percent": rates(said[1], true[both]),
            "verdicts_that_differ": int(np.sum(said[0] != said[1])),
            "locations": {"p_root_m": points.round(4).tolist(), "reachable": true.tolist(), "said": verdict.tolist()},
            "processor_s": seconds,
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """The box from above and from its side: right and wrong verdicts."""
        figure, axes = panels(2, 4.6, 4.6)
        where = numbers["locations"]
        points, true = 100 * np.array(where["p_root_m"]), np.array(where["reachable"])
        said = np.array(where["said"], dtype=object)
        known = np.array([one is not None for one in said])
        yes = np.array([one is True for one in said])
        kinds = {
            "within reach, and said so": (known & yes & true, "o", "C0"),
            "out of reach, and said so": (known & ~yes & ~true, "o", "0.75"),
            "said to be within reach, is not": (known & yes & ~true, "X", "C3"),
            "said to be out of reach, is not": (known & ~yes & true, "P", "C1"),
            "not fixated": (~known, "x", "k"),
        }
        for axis, (across, name) in zip(axes, ((1, "left (cm)"), (2, "up (cm)")), strict=True):
            for label, (which, marker, color) in kinds.items():
                axis.scatter(
                    -points[which, 0], -points[which, 1] if across == 1 else points[which, 2],
                    s=22, marker=marker, color=color, label=f"{label}: {which.sum()}",
                )  # fmt: skip
            axis.set(xlabel="ahead of the robot's middle (cm)", ylabel=name, aspect="equal")
            axis.grid(alpha=0.25)
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2, fontsize=8)
        figure.suptitle("Within reach? The map's answer to the gaze with which the eyes fixate a red ball", fontsize=10)
        return figure


def _known(gaze_rad: Array) -> Mask:
    return np.asarray(np.isfinite(gaze_rad).all(axis=1))


def _looked(robot: Robot, points: Array, seed: int) -> list[Looked]:
    """The ball fixated at each point (N, 3), the eyes starting from where it last was; the arms hang."""
    rig = icub_rig(robot)
    yaw, pitch, tilt, vergence = OnlookerParams().ahead_rad
    q = set_gaze(robot, np.zeros(robot.n_joints), yaw, pitch, tilt, 0.0, vergence)
    looked = []
    with Eyes(robot, rig, make_stimulus("ball"), sensor=SENSOR, fidelity=FIDELITY) as eyes:
        onlooker = Onlooker(robot, rig, eyes, _RED, np.random.default_rng((seed, 2)))
        for point in tqdm(points, desc="red ball", unit="location", disable=None):
            looked.append(onlooker.fixate(q, point))
            q = looked[-1].q_rad
    return looked

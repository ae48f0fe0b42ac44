"""The whole of J in one run: babbling, forward model, inverse kinematics, both maps, and their scores.

The hand is fixated by kinematics within joint limits; inverse kinematics uses the forward model learned from that,
never the robot's own.  Maps are judged against the learned kinematics, as in J, and against the true kinematics.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.reach.babbling import Babbled, babble
from learning.reach.labels import ReachOracle
from learning.reach.training import train_reachable_map
from pps_vision.experiments.baselines import jamone
from pps_vision.experiments.reach_paper import figures
from pps_vision.experiments.reach_truth import SCORES, MapTruth, exact_map, judge_by_labels, learn_hand, map_params
from pps_vision.experiments.study import interval
from pps_vision.experiments.tables import Table, estimate
from pps_vision.robot.icub import load_icub


def run(seeds: Sequence[int], n_tried: int, n_labels: int, n_labels_of_j: int, n_test: int) -> dict[str, Any]:
    """Return the scores of each map against the true and the learned kinematics, with 95 % intervals over repetitions.

    Extreme postures and samples for the figures come from the first repetition.
    """
    repetitions = [
        _repetition(seed, n_tried, n_labels, n_labels_of_j, n_test, with_samples=seed == seeds[0])
        for seed in tqdm(seeds, desc="repetitions", disable=None)
    ]
    maps = {
        name: {
            truth: {key: interval([[run["maps"][name][truth][key]] for run in repetitions]) for key in scores}
            for truth, scores in by_truth.items()
        }
        for name, by_truth in repetitions[0]["maps"].items()
    }
    return {**repetitions[0], "maps": maps}


def _repetition(
    seed: int, n_tried: int, n_labels: int, n_labels_of_j: int, n_test: int, with_samples: bool
) -> dict[str, Any]:
    """Learn our map and J's from the same babbling and judge them; `with_samples` also sample the figures."""
    robot = load_icub()
    rng = np.random.default_rng(seed)
    babbled = babble(robot, "right", n_tried, rng)
    hand = learn_hand(babbled)
    params = map_params(n_labels)
    learned = train_reachable_map(robot, "right", rng, params, hand)
    limits = params.gaze_limits
    max_error_m = learned.max_error_m
    gaze = rng.uniform(limits.lower, limits.upper, (n_labels_of_j, 3))
    labels = ReachOracle(robot, "right", params, rng, hand).label(gaze)
    maps = {
        "ours": learned.query,
        "J: LWPR on labels everywhere": jamone.learn_map(labels, max_error_m, limits),
    }
    test_rng = np.random.default_rng(seed + 1_000_000)
    truth = MapTruth.of(robot, n_test, test_rng)
    test_labels = ReachOracle(robot, "right", params, test_rng, hand).label(truth.gaze_rad)
    scores = {
        name: {
            "true": truth.judge(query, max_error_m),
            "learned": judge_by_labels(query, test_labels, max_error_m),
        }
        for name, query in maps.items()
    }
    if not with_samples:
        return {"maps": scores}
    return {
        "maps": scores,
        "extremes": _extremes(babbled),
        "planes": figures.sample_planes({"true kinematics": exact_map(robot, max_error_m), **maps}, robot, babbled),
        "space": figures.sample_space(learned.labels, learned.query, max_error_m, test_rng),
    }


def _extremes(babbled: Babbled) -> dict[str, dict[str, float]]:
    """Return points C and D of J Fig 3, the farthest and the closest fixated hand; degrees."""
    gaze_deg = np.rad2deg(babbled.gaze_rad)
    vergence_deg = gaze_deg[:, 2]
    return {
        name: {
            "yaw_deg": float(gaze_deg[k, 0]),
            "vergence_deg": float(vergence_deg[k]),
            "elbow_deg": float(np.rad2deg(babbled.arm_rad[k, 3])),
        }
        for name, k in (("C, farthest", vergence_deg.argmin()), ("D, closest", vergence_deg.argmax()))
    }


def chart(numbers: dict[str, Any]) -> dict[str, Figure]:
    """Draw gaze space (J Figs 4, 7), and R on slices of it (J Fig 8) and in the box of locations (J Fig 9)."""
    return {
        "space": figures.space(numbers["space"]),
        "slices": figures.slices(numbers["planes"]["slices"], numbers["extremes"]),
        "box": figures.box(numbers["planes"]["box"]),
    }


def table(numbers: dict[str, Any]) -> Table:
    """Return the scores against the true and the learned kinematics beside J's."""
    rows = [
        [
            f"{name}; {truth} kinematics",
            *(estimate(scores[key], 2) if key in scores else "–" for key in SCORES.values()),
        ]
        for name, by_truth in numbers["maps"].items()
        for truth, scores in by_truth.items()
    ]
    rows.append(["J's figures", *(f"{jamone.PUBLISHED[key]:g}" for key in list(SCORES.values())[:-1]), "–"])
    return Table(["map; judged against", *SCORES], rows)

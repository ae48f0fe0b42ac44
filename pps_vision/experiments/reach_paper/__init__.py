"""Jamone et al. reproduced: maps from babbling alone, maps of each arm and of both, and stated error bounds.

In the whole paper the hand is fixated by kinematics within joint limits; inverse kinematics uses the forward model
learned from that, never the robot's own. Maps are judged against the learned kinematics, as in J, and against the true
kinematics.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.reach.babbling import Babbled, babble
from learning.reach.labels import ReachOracle
from learning.reach.map import both
from learning.reach.training import train_reachable_map
from pps_vision.experiments.baselines import jamone
from pps_vision.experiments.reach_paper import figures
from pps_vision.experiments.reach_truth import (
    ARMS,
    SCORES,
    MapTruth,
    closed_form,
    exact_map,
    judge_by_labels,
    learn_hand,
    map_params,
)
from pps_vision.experiments.study import Part, PartsStudy, SampledStudy, interval, percent_of
from pps_vision.experiments.tables import Table, estimate
from pps_vision.robot.gaze import fixation_points
from pps_vision.robot.icub import load_icub


def _whole_paper(study: "ReachPaper") -> dict[str, Any]:
    """Return the scores of each map against the true and the learned kinematics, with 95 % intervals over repetitions.

    Extreme postures and samples for the figures come from the first repetition.
    """
    repetitions = [_repetition(study, seed) for seed in tqdm(study.seeds, desc="repetitions", disable=None)]
    maps = {
        name: {
            truth: {key: interval([[run["maps"][name][truth][key]] for run in repetitions]) for key in scores}
            for truth, scores in by_truth.items()
        }
        for name, by_truth in repetitions[0]["maps"].items()
    }
    return {**repetitions[0], "maps": maps}


def _repetition(study: "ReachPaper", seed: int) -> dict[str, Any]:
    """Learn our map and J's from the same babbling and judge them; the first repetition also samples the figures."""
    robot = load_icub()
    rng = np.random.default_rng(seed)
    babbled = babble(robot, "right", study.n_tried, rng)
    hand = learn_hand(babbled)
    params = map_params(study.n_labels)
    learned = train_reachable_map(robot, "right", rng, params, hand)
    limits = params.gaze_limits
    max_error_m = learned.max_error_m
    gaze = rng.uniform(limits.lower, limits.upper, (study.n_labels_of_j, 3))
    labels = ReachOracle(robot, "right", params, rng, hand).label(gaze)
    maps = {"ours": learned.query, "J: LWPR on labels everywhere": jamone.learn_map(labels, max_error_m, limits)}
    test_rng = np.random.default_rng(seed + 1_000_000)
    truth = MapTruth.of(robot, study.n_test, test_rng)
    test_labels = ReachOracle(robot, "right", params, test_rng, hand).label(truth.gaze_rad)
    scores = {
        name: {"true": truth.judge(query, max_error_m), "learned": judge_by_labels(query, test_labels, max_error_m)}
        for name, query in maps.items()
    }
    if seed != study.seed:
        return {"maps": scores}
    return {
        "maps": scores,
        "extremes": _extremes(babbled),
        "planes": figures.sample_planes({"true kinematics": exact_map(robot, max_error_m), **maps}, robot, babbled),
        "space": figures.sample_space(learned.labels, learned.query, max_error_m, test_rng),
    }


def _extremes(babbled: Babbled) -> dict[str, dict[str, float]]:
    """Return points C and D of J Fig 3, the farthest and the closest fixated hand; degrees."""
    vergence = babbled.gaze_rad[:, 2]
    points = {}
    for name, k in (("C, farthest", vergence.argmin()), ("D, closest", vergence.argmax())):
        angles = np.rad2deg([babbled.gaze_rad[k, 0], vergence[k], babbled.arm_rad[k, 3]]).tolist()
        points[name] = dict(zip(("yaw_deg", "vergence_deg", "elbow_deg"), angles, strict=True))
    return points


def _whole_paper_chart(numbers: dict[str, Any]) -> dict[str, Figure]:
    """Draw gaze space (J Figs 4, 7), and R on slices of it (J Fig 8) and in the box of locations (J Fig 9)."""
    return {
        "space": figures.space(numbers["space"]),
        "slices": figures.slices(numbers["planes"]["slices"], numbers["extremes"]),
        "box": figures.box(numbers["planes"]["box"]),
    }


def _whole_paper_table(numbers: dict[str, Any]) -> Table:
    """Return the scores against the true and the learned kinematics beside J's."""
    rows = []
    for name, by_truth in numbers["maps"].items():
        for truth, scores in by_truth.items():
            cells = [estimate(scores[key], 2) if key in scores else "–" for key in SCORES.values()]
            rows.append([f"{name}; {truth} kinematics", *cells])
    rows.append(["J's figures", *(f"{jamone.PUBLISHED[key]:g}" for key in list(SCORES.values())[:-1]), "–"])
    return Table(["map; judged against", *SCORES], rows)


def _repeated_maps(study: "ReachPaper") -> dict[str, Any]:
    """Return the scores (percent, RMS of R) and the reachable share (percent) of every map of `reach train`."""
    robot = load_icub()
    params = map_params(study.n_labels)
    rows = []
    for seed in tqdm(study.seeds, desc="seeds", unit="pair of maps", disable=None):
        left, right = (MapTruth.of(robot, study.n_test, np.random.default_rng(seed + 1_000_000), arm) for arm in ARMS)
        maps = [train_reachable_map(robot, arm, np.random.default_rng(seed), params) for arm in ARMS]
        for truth, learned in zip((left, right, left.with_arm(right)), (*maps, both(*maps)), strict=True):
            scores = truth.judge(learned.query, learned.max_error_m)
            rows.append({"seed": seed, "arm": learned.side, "reachable": 100 * float(truth.reachable.mean()), **scores})
    return {"maps": rows}


def _repeated_maps_table(numbers: dict[str, Any]) -> Table:
    """Return mean and largest score of the maps of each arm, and of both."""
    rows = []
    for arm in (*ARMS, "both"):
        maps = [row for row in numbers["maps"] if row["arm"] == arm]
        reachable = f"{np.mean([row['reachable'] for row in maps]):.3g}"
        scores = ([row[key] for row in maps] for key in SCORES.values())
        rows.append([arm, str(len(maps)), reachable, *(f"{np.mean(score):.2g} / {max(score):.2g}" for score in scores)])
    return Table(["arm", "maps", "reachable (%)", *(f"{name}: mean / largest" for name in SCORES)], rows)


def _error_bound(study: "ReachPaper") -> dict[str, Any]:
    """Return for each map the requested, stated and measured error, and the share of bounds that hold.

    Maps of both arms are learned until the bound or the budget of labels is met.
    """
    robot = load_icub()
    maps: list[dict[str, Any]] = []
    pairs = list(product(enumerate(study.requested), range(study.n_bounds), enumerate(ARMS)))
    for (i, requested), k, (arm_index, arm) in tqdm(pairs, "stated bounds", unit="map", disable=None):
        rng = np.random.default_rng((study.seed + k, arm_index, i))
        learned = train_reachable_map(robot, arm, rng, replace(map_params(study.n_labels), max_error=requested))
        gaze = rng.uniform(learned.limits.lower, learned.limits.upper, (study.n_bound_test, 3))
        reachable = np.isfinite(closed_form(robot, arm).solve(fixation_points(robot, gaze))[:, 0])
        maps.append(
            {
                "requested": requested,
                "arm": arm,
                "labels": len(learned.labels.gaze_rad) + learned.unanswered,
                "stated": learned.error_bound,
                "measured": float(np.mean(learned.query(gaze).reachable != reachable)),
            }
        )
    return {"maps": maps, "hold_percent": percent_of(_n_holding(maps), len(maps))}


def _error_bound_table(numbers: dict[str, Any]) -> Table:
    """Return for each requested bound and arm: maps, bounds that hold, requests met, and means."""
    rows = []
    for requested, arm in product(dict.fromkeys(row["requested"] for row in numbers["maps"]), ARMS):
        maps = [row for row in numbers["maps"] if row["requested"] == requested and row["arm"] == arm]
        met = sum(row["stated"] <= requested for row in maps)
        shares = (f"{100 * np.mean([row[key] for row in maps]):.3g}" for key in ("stated", "measured"))
        labels = f"{np.mean([row['labels'] for row in maps]):.0f}"
        counts = map(str, (len(maps), _n_holding(maps), met))
        rows.append([f"{100 * requested:g} %, {arm}", *counts, *shares, labels])
    holding = f"{_n_holding(numbers['maps'])}; {estimate(numbers['hold_percent'])} %"
    rows.append(["all", str(len(numbers["maps"])), holding, *["–"] * 4])
    header = ["requested", "maps", "bounds that hold", "requests met", "stated (%)", "measured (%)", "labels"]
    return Table(header, rows)


def _n_holding(maps: list[dict[str, Any]]) -> int:
    return sum(row["measured"] <= row["stated"] for row in maps)


@dataclass(frozen=True)
class ReachPaper(SampledStudy, PartsStudy):
    """Reachable-space maps of Jamone et al."""

    PARTS: ClassVar[Mapping[str, Part]] = {
        "whole_paper": Part(_whole_paper, _whole_paper_chart, _whole_paper_table),
        "repeated_maps": Part(_repeated_maps, table=_repeated_maps_table),
        "error_bound": Part(_error_bound, table=_error_bound_table),
    }
    SHORT: ClassVar[Mapping[str, Any]] = {
        "n_bounds": 1,
        "n_tried": 500,
        "n_labels_of_j": 600,
        "n_bound_test": 500,
        "requested": (0.05,),
    }

    n: int = 5  # repetitions of training, in the whole paper and for the maps of each arm
    n_tried: int = 20_000  # arm postures babbled
    n_labels: int = 24_000  # inverse-kinematics solutions per map; of maps with a requested error, at most
    n_labels_of_j: int = 52_000  # inverse-kinematics solutions of J's map
    n_test: int = 20_000  # gaze postures at which maps are judged
    n_bounds: int = 10  # maps of each arm per requested error bound
    requested: tuple[float, ...] = (0.01, 0.003, 0.001)  # requested error bounds
    n_bound_test: int = 100_000  # gaze postures at which a stated bound is judged

"""Jamone et al. reproduced: maps from babbling alone, maps of each arm and of both, and stated error bounds.

In the whole paper the hand is fixated by kinematics within joint limits; inverse kinematics uses the forward model
learned from that, never the robot's own. Maps are judged against the learned kinematics, as in J, and against the true
kinematics. J's figures of the Basic map on slices and planes (Figs 5, 6) are not drawn: R above 0.5 means reachable.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.reach.labels import Labels, ReachOracle
from learning.reach.map import both
from learning.reach.training import train_reachable_map
from pps_vision.app.intervals import percent_of
from pps_vision.experiments import charts, reach_seen
from pps_vision.experiments.babbling import Babbled, babble
from pps_vision.experiments.baselines import jamone
from pps_vision.experiments.baselines.jamone import MapQuery
from pps_vision.experiments.reach_truth import (
    ARMS,
    BOX,
    SCORES,
    MapTruth,
    closed_form,
    exact_map,
    judge_by_labels,
    learn_hand,
    map_params,
    to_root,
    to_simulator,
)
from pps_vision.experiments.study import Part, PartsStudy, SampledStudy, interval
from pps_vision.experiments.tables import Table, estimate
from pps_vision.robot.gaze import GazeLimits, fixation_points, gaze_for_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Mask

_N_YAWS = 60
_N_VERGENCES = 56
_N_SIDE = 48  # locations along a side of a plane
_N_SPACE = 4000  # gaze postures per panel of gaze space
_MAX_BABBLED = 400
_PITCHES_DEG = (0, -25)
_PITCH_HALF_WIDTH_DEG = 3
_PLANE_HALF_WIDTH_M = 0.02
_PLANES = {"seen from above, Y 0.85 m": (0, 2), "seen from the side, X 0 m": (2, 1)}  # horizontal and vertical axis


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
    babbled = babble(robot, study.n_tried, rng)
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
        "planes": _sample_planes({"true kinematics": exact_map(robot, max_error_m), **maps}, robot, babbled),
        "space": _sample_space(learned.labels, learned.query, max_error_m, test_rng),
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
        "space": _draw_space(numbers["space"]),
        "slices": _draw_slices(numbers["planes"]["slices"], numbers["extremes"]),
        "box": _draw_box(numbers["planes"]["box"]),
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


def _sample_planes(maps: Mapping[str, MapQuery], robot: Robot, babbled: Babbled) -> dict[str, Any]:
    """Return the degree R (percent) of each map on slices of gaze space and on planes through J's box."""
    return {
        "slices": {f"pitch {pitch}°": _sample_slice(maps, pitch, babbled) for pitch in _PITCHES_DEG},
        "box": {title: _sample_box(maps, robot, *axes, babbled) for title, axes in _PLANES.items()},
    }


def _sample_space(labels: Labels, query: MapQuery, max_error_m: float, rng: np.random.Generator) -> dict[str, Any]:
    """Return gaze postures (degrees), whether they are reachable, and R (percent): training data and map."""
    n = len(labels.gaze_rad)
    some = labels.only(np.isin(np.arange(n), rng.permutation(n)[:_N_SPACE]))
    degree = jamone.degree(some.reachable, some.optimality, some.error_m, max_error_m)
    limits = GazeLimits()
    gaze = rng.uniform(limits.lower, limits.upper, (_N_SPACE, 3))
    predicted = query(gaze)
    return {
        "training data": _space_samples(some.gaze_rad, some.reachable, degree),
        "map": _space_samples(gaze, predicted.reachable, predicted.degree),
    }


def _space_samples(gaze_rad: Array, reachable: Mask, degree: Array) -> dict[str, Any]:
    return {
        "gaze_deg": np.rad2deg(gaze_rad).round(1).tolist(),
        "reachable": reachable.astype(int).tolist(),
        "degree": np.round(100 * degree).astype(int).tolist(),
    }


def _draw_space(samples: dict[str, Any]) -> Figure:
    """Draw Basic and Enhanced map over yaw, pitch and vergence: training data left, map right (J Figs 4, 7)."""
    figure = Figure((8.6, 7.6), layout="constrained")
    style = {"cmap": "RdYlBu", "vmin": 0, "vmax": 1, "linewidths": 0, "depthshade": False}
    panels = [
        (f"{title}: {source}", points, np.array(points[key]) / scale)
        for title, key, scale in (("Basic map (J Fig 4)", "reachable", 1), ("Enhanced map (J Fig 7)", "degree", 100))
        for source, points in samples.items()
    ]
    for k, (title, points, value) in enumerate(panels):
        axis = figure.add_subplot(2, 2, k + 1, projection="3d")
        gaze = np.array(points["gaze_deg"])
        reachable = np.array(points["reachable"], dtype=bool)
        axis.scatter(*gaze[~reachable].T, c=value[~reachable], s=2.5, alpha=0.4, **style)
        image = axis.scatter(*gaze[reachable].T, c=value[reachable], s=8, alpha=0.9, **style)
        axis.set(xlabel="neck yaw (°)", ylabel="neck pitch (°)", zlabel="vergence (°)")
        axis.set_title(title, fontsize=9)
        axis.tick_params(labelsize=7)
        axis.view_init(elev=18, azim=-60)
    figure.colorbar(image, ax=figure.axes, label="reachable (0, 1); degree of reachability R", shrink=0.5, pad=0.08)
    return figure


def _draw_slices(samples: dict[str, Any], extremes: Mapping[str, Mapping[str, float]]) -> Figure:
    """Draw R over yaw and vergence; line: true border; dots: babbled postures; C and D of J Fig 3."""
    figure, axes = _draw(samples)
    for axis in axes:
        axis.set(yscale="log")
        axis.set_yticks([5, 10, 20, 40, 80], ["5", "10", "20", "40", "80"])
        axis.minorticks_off()
    for name, point in extremes.items():
        position = (point["yaw_deg"], point["vergence_deg"])
        axes[0].plot(*position, "k^", ms=6)
        label = f"{name}, elbow {point['elbow_deg']:.0f}°"
        axes[0].annotate(label, position, (0, -12), textcoords="offset points", ha="center", fontsize=7)
    figure.supxlabel("neck yaw (°)", fontsize=9)
    figure.supylabel("vergence (°)", fontsize=9)
    return figure


def _draw_box(samples: dict[str, Any]) -> Figure:
    """Draw R in J's box of locations; white: cannot be fixated; dots: babbled positions of the hand."""
    figure, axes = _draw(samples)
    for k, axis in enumerate(axes):
        across, up = list(_PLANES.values())[k * len(_PLANES) // len(axes)]
        axis.set(xlabel=f"{'XYZ'[across]} (m, simulator)", ylabel=f"{'XYZ'[up]} (m)")
    return figure


def _sample_slice(maps: Mapping[str, MapQuery], pitch_deg: float, babbled: Babbled) -> dict[str, Any]:
    """Samples over yaws and vergences of one pitch, in degrees."""
    limits = GazeLimits()
    yaw = np.linspace(*limits.yaw_rad, _N_YAWS)
    vergence = np.geomspace(*limits.vergence_rad, _N_VERGENCES)
    vergences, yaws = np.meshgrid(vergence, yaw, indexing="ij")
    grid = np.stack([yaws, np.full_like(yaws, np.deg2rad(pitch_deg)), vergences], axis=-1).reshape(-1, 3)
    gaze_deg = np.rad2deg(babbled.gaze_rad)
    near = np.abs(gaze_deg[:, 1] - pitch_deg) <= _PITCH_HALF_WIDTH_DEG
    gaze = grid.clip(limits.lower, limits.upper)  # geomspace rounds
    return _sample(maps, np.rad2deg(yaw), np.rad2deg(vergence), gaze, gaze_deg[near][:, [0, 2]])


def _sample_box(maps: Mapping[str, MapQuery], robot: Robot, across: int, up: int, babbled: Babbled) -> dict[str, Any]:
    """Samples on a plane through the middle of J's box, spanned by two axes of the simulator, m."""
    x, y = (np.linspace(low, high, _N_SIDE) for low, high in BOX[[across, up]])
    points = np.tile(BOX.mean(axis=1), (_N_SIDE**2, 1))
    points[:, across], points[:, up] = (values.ravel() for values in np.meshgrid(x, y))
    hands = to_simulator(fixation_points(robot, babbled.gaze_rad))
    normal = 3 - across - up
    near = np.abs(hands[:, normal] - BOX[normal].mean()) <= _PLANE_HALF_WIDTH_M
    near &= ((hands >= BOX[:, 0]) & (hands <= BOX[:, 1]))[:, [across, up]].all(axis=1)
    return _sample(maps, x, y, gaze_for_points(robot, to_root(points)), hands[near][:, [across, up]])


def _sample(maps: Mapping[str, MapQuery], x: Array, y: Array, gaze_rad: Array, babbled: Array) -> dict[str, Any]:
    """R (percent) of each map over x (w,) and y (h,), whose gaze (h·w, 3) is NaN where a location cannot be fixated."""
    fixated = np.isfinite(gaze_rad[:, 0])
    grids = {}
    for name, query in maps.items():
        percent = np.full(len(fixated), np.nan)
        percent[fixated] = 100 * query(gaze_rad[fixated]).degree
        rows = percent.reshape(len(y), len(x)).tolist()
        grids[name] = [[None if np.isnan(value) else round(value) for value in row] for row in rows]
    axes = {"x": x.round(3).tolist(), "y": y.round(3).tolist()}
    return {**axes, "grids": grids, "babbled": babbled[:_MAX_BABBLED].round(3).tolist()}


def _draw(planes: dict[str, Any]) -> tuple[Figure, list[Axes]]:
    """Draw a row of panels per plane, a panel per map; the first map is the truth."""
    panels = [(title, plane, name) for title, plane in planes.items() for name in plane["grids"]]
    figure, axes = charts.panels(len(panels), len(panels) // len(planes), 3.4, 3.1)
    for axis, (title, plane, name) in zip(axes, panels, strict=True):
        grids = {key: np.array(percent, dtype=float) / 100 for key, percent in plane["grids"].items()}
        truth = next(iter(grids.values()))
        image = axis.pcolormesh(plane["x"], plane["y"], grids[name], vmin=0, vmax=1, cmap="RdYlBu", shading="nearest")
        if np.nanmin(truth) < 0.5 < np.nanmax(truth):
            axis.contour(plane["x"], plane["y"], truth, levels=[0.5], colors="0.1", linewidths=1)
        points = np.array(plane["babbled"], dtype=float).reshape(-1, 2)
        axis.plot(*points.T, ".", color="white", ms=2.5, mec="0.3", mew=0.2)
        axis.set(xlim=(plane["x"][0], plane["x"][-1]), ylim=(plane["y"][0], plane["y"][-1]))
        axis.set_title(f"{name}\n{title}", fontsize=8)
        axis.tick_params(labelsize=7)
    figure.colorbar(image, ax=axes, label="degree of reachability R (reachable above 0.5)", shrink=0.8)
    return figure, axes


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

    MINUTES: ClassVar[int] = 24
    PARTS: ClassVar[Mapping[str, Part]] = {
        "whole_paper": Part(_whole_paper, _whole_paper_chart, _whole_paper_table),
        "repeated_maps": Part(_repeated_maps, table=_repeated_maps_table),
        "error_bound": Part(_error_bound, table=_error_bound_table),
        "seen_hand": Part(reach_seen.run, table=reach_seen.table),
    }
    SHORT: ClassVar[Mapping[str, Any]] = {
        "n_bounds": 1,
        "n_tried": 500,
        "n_labels_of_j": 600,
        "n_bound_test": 500,
        "n_rendered": 20,
        "requested": (0.05,),
    }

    n: int = 3  # repetitions of training, in the whole paper and for the maps of each arm
    n_tried: int = 20_000  # arm postures babbled
    n_labels: int = 24_000  # inverse-kinematics solutions per map; of maps with a requested error, at most
    n_labels_of_j: int = 52_000  # inverse-kinematics solutions of J's map
    n_test: int = 20_000  # gaze postures at which maps are judged
    n_bounds: int = 4  # maps of each arm per requested error bound
    requested: tuple[float, ...] = (0.01, 0.003, 0.001)  # requested error bounds
    n_bound_test: int = 100_000  # gaze postures at which a stated bound is judged
    n_rendered: int = 300  # postures rendered and tracked, twice

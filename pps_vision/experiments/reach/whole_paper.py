"""The whole paper (J) in one run: babbling, forward model, inverse kinematics, both maps, and their scores.

The hand is fixated by kinematics, the joint limits decide which postures can be; inverse kinematics runs on what was
learned from them, never on the robot's own model.  Ours asks where the border is; as J has it, labels 0.75 / 0.25 and
degrees of reachability everywhere, learned by LWPR.  Judged against the learned kinematics (as J does) and the true.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from learning.reach.babbling import Babbled, babble, score
from learning.reach.map import Labels
from learning.reach.training import HandModel, MapParams, ReachOracle, train_reachable_map
from learning.reach.turning_joints import TurningJoints
from pps_vision.experiments.baselines.lwpr import LWPR, LWPRParams
from pps_vision.experiments.baselines.lwpr_metric import MetricParams
from pps_vision.experiments.reach import paper_figures
from pps_vision.experiments.reach.map_test import MapTest, closed_form, rates
from pps_vision.experiments.study import Study
from pps_vision.robot.gaze import GazeLimits, fixation_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Mask

_PAPER = {"forward_model_deg": 0.84, "je": 1.3, "fn": 4.7, "fp": 0.4, "degree_rmse": 0.022}
_GOAL_S = 300
_N_TRIED, _N_TEST = 20_000, 700
_LWPR_OF_THE_MAP = LWPRParams(init_D=600, w_gen=0.2, metric=MetricParams(rate=0))  # some 10 000 fields
_AS_J = "as J: LWPR on labels everywhere"

Query = Callable[[Array], tuple[Mask, Array]]  # gaze postures (N, 3) -> said to be reachable (N,), degree (N,)


@dataclass(frozen=True)
class WholePaper(Study):
    """Babbling 20 000 postures, the forward model, 52 000 inverse-kinematics solutions, Basic and Enhanced map."""

    seed: int = 0
    """Seed of the babbling and of the labels; what is judged on has another."""
    labels: tuple[int, ...] = (24_000,)
    """Inverse-kinematics solutions our map is learned with."""
    labels_as_j: int = 52_000
    """And the map as J has it; 0 leaves it out."""
    n_test: int = 10_000
    """Gaze postures the maps are judged on."""

    def run(self) -> dict[str, Any]:
        """Seconds of processor of each stage, and by map its scores against the learned and the true kinematics."""
        if not self.labels or min(self.labels) < 100:
            raise ValueError(
                f"bench reach whole_paper: labels {self.labels}; expected one number or more, of 100 at least"
            )
        robot, rng, seconds = load_icub(), np.random.default_rng(self.seed), _Stages()
        with seconds("babbling"):
            babbled = babble(robot, "right", _N_TRIED, rng)
        with seconds("forward model"):
            model = _taught(babbled)
        hand = HandModel(model.forward, model.points, model.gaze)
        maps: dict[str, Query] = {}
        unanswered = {}
        for n in self.labels:
            params = replace(MapParams(), n_labels=n, round_labels=min(MapParams().round_labels, n // 2))
            with seconds(f"ours, {n} labels"):
                learned = train_reachable_map(robot, "right", rng, params, hand)
            maps[f"ours, {n} labels"] = lambda gaze, m=learned: _asked(m.query(gaze))  # type: ignore[misc]
            unanswered[f"ours, {n} labels"] = learned.unanswered
        most = learned.max_error_m
        if self.labels_as_j:
            with seconds(f"labels of {_AS_J}"):
                labels = ReachOracle(robot, "right", MapParams(), rng, hand).label(_anywhere(self.labels_as_j, rng))
            with seconds(_AS_J):
                maps[_AS_J] = _as_j(labels.only(labels.answered), most)
            unanswered[_AS_J] = int((~labels.answered).sum())
        test_rng = np.random.default_rng(self.seed + 1_000_000)
        truth = MapTest.of(robot, self.n_test, test_rng)
        believed = ReachOracle(robot, "right", MapParams(), test_rng, hand).label(truth.gaze_rad)
        return {
            "fixated_of_20000": len(babbled.arm_rad),
            "forward_model_deg": score(model, _few(babble(robot, "right", 4 * _N_TEST, test_rng)))[0],
            "seconds": seconds.spent,
            "from_babbling_to_the_map_s": {
                name: seconds.spent["babbling"] + sum(s for stage, s in seconds.spent.items() if name in stage)
                + seconds.spent["forward model"] for name in maps
            },
            "goal_s": _GOAL_S,
            "paper": _PAPER,
            "unanswered": unanswered,
            "maps": {name: _judged(query, truth, believed, most) for name, query in maps.items()},
            "extremes": _extremes(babbled),
            "drawn": _drawn(robot, babbled, maps, most),
        }  # fmt: skip

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Slices through the maps (J Figs 3, 5, 8), and the box of Cartesian locations (J Figs 6, 9)."""
        drawn = numbers["drawn"]
        return {"slices": paper_figures.slices(drawn, numbers["extremes"]), "box": paper_figures.box(drawn)}


class _Stages:
    """Seconds of processor each stage took."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        begun = time.process_time()
        yield
        self.spent[stage] = time.process_time() - begun


def _taught(babbled: Babbled) -> TurningJoints:
    """All at once: it would take a sample at a time as well."""
    model = TurningJoints()
    model.learn(babbled.arm_rad, babbled.gaze_rad)
    model.forward(babbled.arm_rad[:1])  # fits
    return model


def _few(babbled: Babbled) -> Babbled:
    return replace(babbled, arm_rad=babbled.arm_rad[:_N_TEST], gaze_rad=babbled.gaze_rad[:_N_TEST])


def _anywhere(n: int, rng: np.random.Generator) -> Array:
    limits = GazeLimits()
    return rng.uniform(limits.lower, limits.upper, (n, 3))


def _asked(said: Any) -> tuple[Mask, Array]:
    return said.reachable, said.degree


def _degree(reachable: Mask, optimality: Array, error_m: Array, most: float) -> Array:
    """R of J IV.6 (as FACTS §6 has it) and IV.7."""
    return np.where(reachable, 0.5 + 0.5 * optimality, 0.5 - 0.5 * np.minimum(error_m / most, 1))


def _as_j(labels: Labels, most: float) -> Query:
    """S and R learned by LWPR, a sample at a time; reachable where S is above 0.5."""
    limits, model = GazeLimits(), LWPR(3, 2, _LWPR_OF_THE_MAP)
    middle, half = (limits.lower + limits.upper) / 2, (limits.upper - limits.lower) / 2
    S = np.where(labels.reachable, 0.75, 0.25)
    R = _degree(labels.reachable, labels.optimality, labels.error_m, most)
    for x, y in zip((labels.gaze_rad - middle) / half, np.stack([S, R], axis=1), strict=True):
        model.update(x, y)

    def query(gaze: Array) -> tuple[Mask, Array]:
        said = model.predict((gaze - middle) / half).mean
        return said[:, 0] > 0.5, said[:, 1]

    return query


def _judged(query: Query, truth: MapTest, believed: Labels, most: float) -> dict[str, Any]:
    """Against the true kinematics and the learned: JE, FN, FP (percent), RMSE of the degree where it has one."""
    said, degree = query(truth.gaze_rad)
    known = {
        "true": (truth.reachable, truth.optimality, truth.error_m),
        "learned": (believed.reachable, believed.optimality, believed.error_m),
    }
    scores: dict[str, Any] = {"no_degree_percent": 100 * float(np.isnan(degree).mean())}
    for name, (reachable, optimality, error_m) in known.items():
        off = degree - _degree(reachable, optimality, error_m, most)
        told = off[np.isfinite(off)]
        rmse = float(np.sqrt(told @ told / len(told))) if len(told) else None
        scores[name] = {**rates(said, reachable), "degree_rmse": rmse}
    scores["box"] = rates(query(truth.box_gaze_rad)[0], truth.box_reachable)
    return scores


def _extremes(babbled: Babbled) -> dict[str, dict[str, float]]:
    """Points C and D of J Fig 3: the farthest and the closest that were reached, degrees."""
    vergence, elbow = np.rad2deg(babbled.gaze_rad[:, 2]), np.rad2deg(babbled.arm_rad[:, 3])
    ends = {"C, farthest": int(vergence.argmin()), "D, closest": int(vergence.argmax())}
    paper = {"C, farthest": (11.17, 15.0), "D, closest": (89.15, 105.0)}
    return {
        name: {
            "yaw_deg": float(np.rad2deg(babbled.gaze_rad[k, 0])),
            "vergence_deg": float(vergence[k]),
            "elbow_deg": float(elbow[k]),
            "vergence_deg_in_j": paper[name][0],
            "elbow_deg_in_j": paper[name][1],
        }
        for name, k in ends.items()
    }


def _drawn(robot: Robot, babbled: Babbled, maps: dict[str, Query], most: float) -> dict[str, Any]:
    """What the figures show: maps and truth on slices of gaze space and of J's box, and the babbled points there."""
    arm, oracle = closed_form(robot), ReachOracle(robot, "right", MapParams(), np.random.default_rng(0))
    largest = max((name for name in maps if name != _AS_J), key=lambda name: int(name.split()[1]))

    def true(gaze: Array) -> tuple[Mask, Array]:
        _, effort = arm.least_effort(fixation_points(robot, gaze), 21)
        reachable = np.isfinite(effort)
        return reachable, _degree(reachable, 1 - effort, oracle.label(gaze).error_m, most)

    shown = {name: maps[name] for name in (largest, _AS_J) if name in maps}
    return paper_figures.measured({"true kinematics": true, **shown}, robot, babbled)

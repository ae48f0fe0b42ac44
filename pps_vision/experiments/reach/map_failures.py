"""Where the reachable-space map breaks: one fault of babbling or of the labels at a time, from mild to hopeless.

From babbling alone, as in `whole_paper`: forward model, inverse kinematics on it, map, with as many solutions for ours
(turning joints, then where the border is) as for J's way (LWPR of the arm, labels everywhere, LWPR of 0.75 / 0.25).
Judged against the true arm in closed form.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.reach.babbling import Babbled, babble, crossing, gaze_at
from learning.reach.map import Labels
from learning.reach.training import HandModel, MapParams, ReachOracle, learned_from
from learning.reach.turning_joints import TurningJoints
from pps_vision.experiments.baselines.lwpr import LWPR, LWPRParams
from pps_vision.experiments.baselines.lwpr_metric import MetricParams
from pps_vision.experiments.baselines.regressors import ArmToGaze, LocalModels
from pps_vision.experiments.reach.failures import CASES as BABBLING
from pps_vision.experiments.reach.forward_model import LWPR_OF_THE_ARM
from pps_vision.experiments.reach.map_test import closed_form, rates
from pps_vision.experiments.study import Study
from pps_vision.robot.gaze import GazeLimits, fixation_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.inverse_kinematics import IKParams
from pps_vision.robot.self_motion import WalkParams
from pps_vision.robot.two_stage import TwoStageParams
from pps_vision.types import Array, Mask

_BREAKS, _DEGRADES = 1.3, 2.0
CRITERION = (
    f"breaks: more than {_BREAKS} % of all gaze postures misjudged (J's own figure), mean of the seeds; "
    f"degrades: {_DEGRADES:g} times as many as undisturbed"
)
_N_TRIED, _N_SAMPLES = 5800, 1500  # postures tried, those learned from
_LWPR_OF_THE_ARM = replace(LWPR_OF_THE_ARM, init_D=40)  # 80 is for three times as many samples
_EYES_M = 0.068
_VERDICTS_ONLY = TwoStageParams(
    IKParams(tolerance=1e-4, max_steps=40, min_step_rad=3e-4), WalkParams(steps=0, finer=1)
)  # no second stage: JE, FN and FP know of no degree
_SURE = 0.99

Query = Callable[[Array], tuple[Mask, Array]]  # gaze postures (N, 3) -> said to be reachable (N,), probability (N,)
Teach = Callable[[Callable[[Array], Labels], MapParams, np.random.Generator], Query]


@dataclass(frozen=True)
class Way:
    """How the arm is learned from babbling, and the map from what inverse kinematics on that arm answers."""

    hand: Callable[[Babbled], HandModel]
    teach: Teach
    color: str


def _turning(babbled: Babbled) -> HandModel:
    model = TurningJoints()
    model.learn(babbled.arm_rad, babbled.gaze_rad)
    return HandModel(model.forward, model.points, model.gaze)


def _local(babbled: Babbled) -> HandModel:
    """LWPR, each sample once, in units of what the eyes see; NaN where no field answers, so that inverse kinematics
    starts from what was babbled and is answered."""
    local = LocalModels(4, 3, _LWPR_OF_THE_ARM)
    model = ArmToGaze(local)
    model.learn(babbled.arm_rad, babbled.gaze_rad)

    def forward(arm: Array) -> tuple[Array, Array]:
        at = (arm - model.middle) / model.half
        return _EYES_M * local.predict(at), _EYES_M * local.model.jacobian(at) / model.half

    def gaze(places: Array, limits: GazeLimits) -> Array:
        found = gaze_at(places / _EYES_M)
        within = ((found >= limits.lower) & (found <= limits.upper)).all(axis=1, keepdims=True)
        return np.where(within, found, np.nan)

    answered = np.isfinite(forward(babbled.arm_rad)[0]).all(axis=1)
    if answered.sum() < 2:
        raise ValueError("LWPR answers nowhere: too few samples for its fields")
    return HandModel(forward, lambda gaze: _EYES_M * crossing(gaze), gaze, tried=babbled.arm_rad[answered])


def _border(label: Callable[[Array], Labels], params: MapParams, rng: np.random.Generator) -> Query:
    learned = learned_from(label, "right", rng, params)

    def query(gaze: Array) -> tuple[Mask, Array]:
        said = learned.query(gaze)
        return said.reachable, said.probability

    return query


def _basic(label: Callable[[Array], Labels], params: MapParams, rng: np.random.Generator) -> Query:
    """J's Basic map; its fields grow with the room each label has."""
    limits = params.gaze_limits
    labels = label(rng.uniform(limits.lower, limits.upper, (params.n_labels, 3)))
    labels = labels.only(labels.answered)
    middle, half = (limits.lower + limits.upper) / 2, (limits.upper - limits.lower) / 2
    wide = 600 * (params.n_labels / 52_000) ** (2 / 3)  # 600: `whole_paper`, whose labels are 52 000
    model = LWPR(3, 1, LWPRParams(init_D=wide, w_gen=0.2, metric=MetricParams(rate=0)))
    for x, S in zip((labels.gaze_rad - middle) / half, np.where(labels.reachable, 0.75, 0.25)[:, None], strict=True):
        model.update(x, S)

    def query(gaze: Array) -> tuple[Mask, Array]:
        S = model.predict((gaze - middle) / half).mean[:, 0]
        return S > 0.5, np.clip(2 * S - 0.5, 0, 1)

    return query


WAYS = {"ours": Way(_turning, _border, "tab:blue"), "as J: LWPR of arm and map": Way(_local, _basic, "tab:orange")}


_FLIPPED, _FEWER = "labels flipped", "fewer labels"
# fault: what is on its axis, and severities, the first of them none
CASES: dict[str, tuple[str, tuple[float, ...]]] = {
    "fixation noise": (BABBLING["fixation noise"][0], (0, 1, 3, 6)),
    "something else fixated": (BABBLING["something else fixated"][0], (0, 10, 25, 50)),
    "elbow read wrongly": (BABBLING["elbow read wrongly"][0], (0, 1, 2, 5)),
    "elbow's encoder stuck": (BABBLING["elbow's encoder stuck"][0], (0, 10, 25, 100)),
    "fewer samples": ("samples left where the other fixations fail", (1500, 200, 100, 50)),
    _FLIPPED: ("share of the labels (%)", (0, 1, 2, 5, 10)),
    _FEWER: ("inverse-kinematics solutions", (1000, 500, 250, 100)),
}
Fault = str | None


@dataclass(frozen=True)
class MapFailures(Study):
    """One fault at a time between babbling and the map."""

    seed: int = 0
    """Seed of the first babbling, its faults and labels; what is judged on has another."""
    n_seeds: int = 3
    """How many such worlds each severity is measured in."""
    n_labels: int = 1000
    """Inverse-kinematics solutions a map is learned with."""
    n_test: int = 4000
    """Gaze postures each is judged on."""

    def run(self) -> dict[str, Any]:
        """By fault and way: JE, FN, FP (percent; mean, least and most of the seeds), what is said surely and wrongly,
        and where it degrades and breaks."""
        if self.n_seeds < 1 or self.n_labels < 100 or self.n_test < 100:
            raise ValueError(
                f"bench reach map_failures: --n-seeds {self.n_seeds}, --n-labels {self.n_labels}, --n-test "
                f"{self.n_test}; expected at least 1, 100 and 100"
            )
        worlds = [_World.of(self.seed + k, self.n_labels, self.n_test) for k in range(self.n_seeds)]
        whole = {way: [world.judge(way) for world in worlds] for way in WAYS}
        return {
            "criterion": CRITERION,
            "samples": _N_SAMPLES,
            "cases": {
                name: {
                    "axis": axis,
                    "severities": list(severities),
                    "ways": {way: _measured(name, severities, way, worlds, whole[way]) for way in WAYS},
                }
                for name, (axis, severities) in tqdm(CASES.items(), desc="faults", disable=None)
            },
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Misjudged over severity, one panel a fault; bars from least to most of the seeds, × where it breaks."""
        cases = numbers["cases"]
        figure, grid = plt.subplots(
            2, len(cases) // 2 + 1, figsize=(14, 6.4), layout="constrained", sharey=True, squeeze=False
        )
        axes = grid.ravel()
        for axis, (name, case) in zip(axes, cases.items(), strict=False):
            _panel(axis, name, case)
        for row in grid:
            row[0].set_ylabel("misjudged gaze postures, JE (%)")
        axes[-1].axis("off")
        axes[-1].legend(*axes[0].get_legend_handles_labels(), fontsize=9, loc="center")
        return figure


@dataclass(frozen=True)
class _World:
    """One babbling, and gaze postures (N, 3) whose answer by the true arm is known, on which maps of it are judged."""

    seed: int
    babbled: Babbled
    gaze_rad: Array
    reachable: Mask
    params: MapParams

    @classmethod
    def of(cls, seed: int, n_labels: int, n_test: int) -> "_World":
        robot, rng = load_icub(), np.random.default_rng(seed)
        babbled = babble(robot, "right", _N_TRIED, rng)
        few = Babbled(babbled.arm_rad[:_N_SAMPLES], babbled.gaze_rad[:_N_SAMPLES], _N_TRIED)
        limits = GazeLimits()
        gaze = np.random.default_rng(seed + 1_000_000).uniform(limits.lower, limits.upper, (n_test, 3))
        reachable = np.isfinite(closed_form(robot).solve(fixation_points(robot, gaze))[:, 0])
        params = MapParams(
            n_labels=n_labels, round_labels=n_labels // 2, n_babble=20_000, lattice=0.06, inverse=_VERDICTS_ONLY
        )
        return cls(seed, few, gaze, reachable, params)

    def judge(self, way: str, fault: Fault = None, severity: float = 0.0) -> dict[str, Any]:
        """Percent misjudged; where nothing at all could be learned, nothing is said to be reachable."""
        rng, params, babbled = np.random.default_rng(self.seed + 2_000_000), self.params, self.babbled
        if fault == _FEWER:
            params = replace(params, n_labels=int(severity), round_labels=int(severity) // 2)
        elif fault in BABBLING:
            babbled = BABBLING[fault][2](babbled, severity, rng)
        why = None
        try:
            oracle = ReachOracle(load_icub(), "right", params, rng, WAYS[way].hand(babbled))
            label = _flipping(oracle.label, severity / 100, rng) if fault == _FLIPPED else oracle.label
            said, probability = WAYS[way].teach(label, params, rng)(self.gaze_rad)
        except ValueError as error:  # nothing learned, which it says
            why, said, probability = str(error), np.zeros_like(self.reachable), np.full(len(self.reachable), np.nan)
        sure = np.maximum(probability, 1 - probability) > _SURE
        return {
            **rates(said, self.reachable),
            "unknown": 100 * float(np.isnan(probability).mean()),
            "surely_wrong": 100 * float(np.mean((said != self.reachable)[sure])) if sure.any() else None,
            "nothing_learned": why,
        }


def _flipping(label: Callable[[Array], Labels], share: float, rng: np.random.Generator) -> Callable[[Array], Labels]:
    """The same answers, some of them the opposite: a posture that reaches is said not to, without a border point."""

    def flipped(gaze: Array) -> Labels:
        labels = label(gaze)
        flip = rng.random(len(gaze)) < share
        return replace(
            labels,
            reachable=labels.reachable ^ flip,
            optimality=np.where(flip, 0.5, labels.optimality),
            border_rad=np.where(flip[:, None], np.nan, labels.border_rad),
        )

    return flipped


def _measured(
    fault: str, severities: tuple[float, ...], way: str, worlds: list[_World], whole: list[dict[str, Any]]
) -> dict[str, Any]:
    """Each severity's numbers over the worlds; the first is none and known as `whole`."""
    rows = [whole, *([world.judge(way, fault, severity) for world in worlds] for severity in severities[1:])]
    said: dict[str, Any] = {
        name: [_spread([judged[name] for judged in row]) for row in rows]
        for name in ("je", "fn", "fp", "unknown", "surely_wrong")
    }
    je = [spread["mean"] for spread in said["je"]]
    for name, bound in (("degrades_at", _DEGRADES * je[0]), ("breaks_at", _BREAKS)):
        said[name] = next((severity for severity, value in zip(severities, je, strict=True) if value > bound), None)
    said["nothing_learned"] = [sorted({judged["nothing_learned"] for judged in row} - {None}) for row in rows]
    return said


def _spread(values: list[float | None]) -> dict[str, float | None]:
    """Mean, least and most of those there are."""
    known = [value for value in values if value is not None]
    return {
        name: round(float(of(known)), 3) if known else None
        for name, of in (("mean", np.mean), ("least", np.min), ("most", np.max))
    }


def _panel(axis: Axes, name: str, case: dict[str, Any]) -> None:
    places = np.arange(len(case["severities"]))
    for k, (way, found) in enumerate(case["ways"].items()):
        mean, least, most = (
            np.array([row[of] for row in found["je"]], dtype=float) for of in ("mean", "least", "most")
        )
        at = places + 0.06 * (k - 0.5)
        axis.errorbar(
            at, mean, (mean - least, most - mean), fmt="o-", ms=4, capsize=3, color=WAYS[way].color, label=way
        )
        if found["breaks_at"] is not None:
            broken = case["severities"].index(found["breaks_at"])
            axis.plot(at[broken], mean[broken], "x", color=WAYS[way].color, ms=12, mew=2)
    axis.axhline(_BREAKS, color="0.4", lw=0.9, ls="--", label=f"breaks: {_BREAKS} %, J's own figure (× first beyond)")
    axis.axhline(19, color="0.4", lw=0.9, ls=":", label="nothing called reachable")
    axis.set_xticks(places, [f"{value:g}" for value in case["severities"]])
    axis.set(yscale="log", ylim=(0.3, 80), xlabel=case["axis"])
    axis.set_title(name, fontsize=10)
    axis.grid(alpha=0.25)

"""R's five sources of robot error: their cost to predictions, compensation by learning, invariance to modality."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.pps.joint_offsets import TouchTrial
from pps_vision.app.encounters.encounter import TRIALS, SessionName
from pps_vision.experiments.charts import bars, panels
from pps_vision.experiments.pps.predictors import Trials, by_map, outcomes
from pps_vision.experiments.pps.robot_errors import SOURCES, ErrorSources, MiscalibratedRobot, errors_from
from pps_vision.experiments.pps.scores import auroc, brier
from pps_vision.experiments.pps.session_trials import SessionStudy, exact_trials
from pps_vision.experiments.pps.taxel_trials import in_taxel_frames
from pps_vision.experiments.study import Part, interval
from pps_vision.experiments.tables import Table, estimate

Exact = Sequence[Sequence[TouchTrial]]  # training and test trials
Sets = list[Trials]  # training and test trials as the taxels perceive them
CASES = ("no errors", "errors, map trained without", "errors, map trained with", "encoder offsets estimated too")
MODALITIES: dict[SessionName, int] = {"motor": 45, "visual": 45, "inner": 53}
"""Trials of the felt finger, the seen finger, and seen objects."""


def scores(sets: Iterable[Sets]) -> dict[str, list[float]]:
    """Return AUROC and Brier score of R's map on pairs of training and test trials, with 95 % over the pairs."""
    predictions = [(outcomes(test), by_map(training, test)) for training, test in sets]
    return {score.__name__: interval([[score(*pair)] for pair in predictions]) for score in (auroc, brier)}


def compensation(study: "PpsErrors") -> dict[str, Any]:
    """Return the scores by source of error and case, with 95 % over robots."""
    exact = [exact_trials("inner", study.size(TRIALS["inner"]), study.seed + i) for i in (0, 1)]
    without: Sets = [in_taxel_frames(trials) for trials in exact]
    sources = {**{name: errors_from(name) for name in SOURCES}, "all": ErrorSources()}
    numbers: dict[str, Any] = {}
    for name, source in tqdm(sources.items(), desc="errors", unit="source", disable=None):
        sets: dict[str, list[Sets]] = {case: [] for case in CASES}
        for k in range(study.n if name == "all" else study.n_single):
            robot = MiscalibratedRobot.draw(source, np.random.default_rng((study.seed, k)))
            observed, erring = _observe(robot, exact, (study.seed, k, 1))
            _, estimated = _observe(robot.calibrated(observed[0]), exact, (study.seed, k, 1))
            of_cases: tuple[Sets, ...] = (without, [without[0], erring[1]], erring, estimated)
            for case, of_case in zip(CASES, of_cases, strict=True):
                sets[case].append(of_case)
        numbers[name] = {case: scores(sets[case]) for case in CASES}
    return {"sources": numbers}


def _observe(robot: MiscalibratedRobot, exact: Exact, seed: tuple[int, ...]) -> tuple[Exact, Sets]:
    """Training and test trials as a robot measures and perceives them, with the slack drawn from `seed`."""
    rng = np.random.default_rng(seed)
    observed = [[robot.observe(trial, True, rng) for trial in trials] for trials in exact]
    return observed, [in_taxel_frames(trials, robot.model, robot.skin) for trials in observed]


def draw_compensation(numbers: dict[str, Any]) -> Figure:
    """Draw AUROC by source and case."""
    figure, (axis,) = panels(1, width=9.0)
    sources = numbers["sources"]
    series = {case: [source[case]["auroc"] for source in sources.values()] for case in CASES}
    bars(axis, list(sources), series, "AUROC (95 % over robots)")
    axis.set_ylim(0.5, 1)
    axis.legend(fontsize=8, ncols=2)
    return figure


def tabulate_compensation(numbers: dict[str, Any]) -> Table:
    """Return both scores with all sources together, and the Brier score above that without errors."""
    cases = numbers["sources"]["all"]
    best = cases["no errors"]["brier"][0]
    rows = []
    for case in CASES:
        above = "–" if case == "no errors" else estimate([value - best for value in cases[case]["brier"]], 2)
        rows.append([case, estimate(cases[case]["auroc"]), estimate(cases[case]["brier"]), above])
    return Table(["all five sources", "AUROC", "Brier score", "above that without errors"], rows)


def invariance(study: "PpsErrors") -> dict[str, Any]:
    """Return the scores by modality of training and of test: two thirds of the trials train, the last third tests."""
    sets = {}
    for name, n in MODALITIES.items():
        trials = in_taxel_frames(study.measured_trials(name, n))
        n_training = 2 * len(trials) // 3
        sets[name] = [trials[:n_training], trials[n_training:]]
    return {"modalities": {a: {b: scores([[sets[a][0], sets[b][1]]]) for b in sets} for a in sets}}


@dataclass(frozen=True)
class PpsErrors(SessionStudy):
    """Compensation: scores of R's map 0.15 s before the touch with R's five error sources, one by one and together.

    R: "the learned representations automatically compensate". Invariance: the map is trained on felt fingers, seen
    fingers or objects and tested on each.
    """

    SHORT: ClassVar[Mapping[str, Any]] = {"n_single": 1}
    PARTS: ClassVar[Mapping[str, Part]] = {
        "compensation": Part(compensation, draw_compensation, tabulate_compensation),
        "invariance": Part(invariance),
    }

    n: int = 20  # robots with all sources together
    n_single: int = 3  # robots with each source alone

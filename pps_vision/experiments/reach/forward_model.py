"""Forward model arm → gaze from motor babbling: error over samples, and time against error (J Fig 2)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Protocol

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.reach.babbling import Babbled, babble
from learning.reach.forward_model import RevoluteArm
from pps_vision.experiments import charts
from pps_vision.experiments.baselines.regressors import (
    ArmToGaze,
    boosted_trees,
    gaussian_process,
    network,
    quintic_spline,
)
from pps_vision.experiments.reach import jamone
from pps_vision.experiments.reach.map_truth import first, gaze_rmse_deg
from pps_vision.experiments.study import SampledStudy, interval
from pps_vision.experiments.tables import Table, estimate
from pps_vision.experiments.timing import timed, timed_steps
from pps_vision.robot.icub import load_icub
from pps_vision.types import Array

_N_TRAIN, _N_TEST, _N_TRIED = 4400, 700, 20_000  # as in J
_N_SINGLE = 50


class Model(Protocol):
    """A forward model arm (N, 4) → gaze (N, 3), learned from samples."""

    def learn(self, arm_rad: Array, gaze_rad: Array) -> None: ...

    def __call__(self, arm_rad: Array) -> Array: ...


METHODS: dict[str, Callable[[], Model]] = {
    "model of revolute joints": RevoluteArm,
    "Gaussian process": lambda: ArmToGaze(gaussian_process()),
    "LWPR, each sample once": jamone.arm_model,
    "LWPR, each sample 4 times": lambda: jamone.arm_model(n_epochs=4),
    "quintic spline (SciPy)": lambda: ArmToGaze(quintic_spline()),
    "network 64×64 (scikit-learn)": lambda: ArmToGaze(network(0)),
    "boosted trees (scikit-learn)": lambda: ArmToGaze(boosted_trees(0)),
}
_DEFAULT, _BASELINES = next(iter(METHODS)), list(METHODS)[1:]


def samples(seed: int) -> tuple[Babbled, Babbled]:
    """Return what 20 000 babbled postures of the right arm teach, and 700 fixated ones to test on."""
    robot, rng = load_icub(), np.random.default_rng(seed)
    return babble(robot, "right", _N_TRIED, rng), first(babble(robot, "right", 4 * _N_TEST, rng), _N_TEST)


def learn_and_time(model: Model, sets: list[Babbled], test: Babbled) -> list[dict[str, Any]]:
    """Return, after each further set, RMSE (degrees), unanswered (percent), and processor time of update and query.

    `update_ms` is the time per sample of that set, `ms` the quartiles of queries of one posture.
    """
    rows = []
    for new in sets:
        _, learning_ms = timed(partial(model.learn, new.arm_rad, new.gaze_rad))
        _, fitting_ms = timed(partial(model, test.arm_rad[:1]))  # of a model that is fitted when first asked
        update_ms = (learning_ms + fitting_ms) / len(new.arm_rad)
        error_deg, unanswered = gaze_rmse_deg(model, test)
        _, ms = timed_steps(model, test.arm_rad[:_N_SINGLE, None])
        rows.append({"rmse_deg": error_deg, "unanswered_percent": 100 * unanswered, "update_ms": update_ms,
                     "ms": np.percentile(ms, (25, 50, 75)).tolist()})  # fmt: skip
    return rows


def mean_row(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the means of the same row of several sets, and `rmse_95_deg`, the 95 % interval of the RMSE over sets."""
    means = {key: np.mean([row[key] for row in rows], axis=0).tolist() for key in rows[0]}
    return {**means, "rmse_95_deg": interval([[row["rmse_deg"]] for row in rows])[1:]}


@dataclass(frozen=True)
class ForwardModel(SampledStudy):
    """The model of revolute joints, LWPR as in J, and other regressors, learned from the same fixated postures."""

    SHORT: ClassVar[Mapping[str, Any]] = {"sizes": (100, 200)}

    n: int = 3
    """Sets of postures, each with its own test set."""
    sizes: tuple[int, ...] = (100, 200, 400, 800, 1600, 3000, _N_TRAIN)
    """Samples after which each is judged."""

    def run(self) -> dict[str, Any]:
        """Return, by method, a row for every number of samples, on 700 postures that none has seen: means over sets."""
        found: dict[str, list[list[dict[str, Any]]]] = {name: [] for name in METHODS}
        fixated = []
        for seed in tqdm(self.seeds, desc="sets of postures", disable=None):
            train, test = samples(seed)
            fixated.append(100 * len(train.arm_rad) / _N_TRIED)
            ends = zip((0, *self.sizes), self.sizes, strict=False)
            sets = [Babbled(train.arm_rad[low:high], train.gaze_rad[low:high], _N_TRIED) for low, high in ends]
            for name, make in METHODS.items():
                found[name].append(learn_and_time(make(), sets, test))
        methods = {name: [mean_row(rows) for rows in zip(*repeats, strict=True)] for name, repeats in found.items()}
        return {"fixated_percent": float(np.mean(fixated)), "samples": self.sizes, "methods": methods}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw error over samples; time of a query and of an update against the error with all samples."""
        found = numbers["methods"]
        figure, (curves, query, update) = charts.panels(3, width=5.2)
        series = {name: [row["rmse_deg"] for row in rows] for name, rows in found.items()}
        charts.curves(curves, numbers["samples"], series, "fixated postures learned from", "gaze RMSE (°)")
        curves.plot(_N_TRAIN, jamone.RESULTS["forward_model_deg"], "k*", ms=10, label="J's LWPR")
        curves.set(xscale="log", yscale="log", title="arm → gaze, learned by babbling (J Fig 2)")
        curves.legend(fontsize=7, loc=(0.4, 0.15))
        last = {name: rows[-1] for name, rows in found.items()}
        rmse = "gaze RMSE (°)"
        charts.speed_error(query, last, "rmse_deg", _BASELINES, _DEFAULT, "query of one posture (ms)", rmse)
        last = {name: {**row, "ms": row["update_ms"]} for name, row in last.items()}
        charts.speed_error(update, last, "rmse_deg", _BASELINES, _DEFAULT, "update (ms per sample)", rmse)
        query.legend(fontsize=7)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return error with few and with all samples, and times with all."""
        samples = numbers["samples"]
        shown = sorted({0, len(samples) // 2, len(samples) - 1})
        rows = [
            [
                name,
                *(estimate([rows[k]["rmse_deg"], *rows[k]["rmse_95_deg"]], 2) for k in shown),
                f"{rows[-1]['ms'][1]:.2g}",
                f"{rows[-1]['update_ms']:.2g}",
            ]
            for name, rows in numbers["methods"].items()
        ]
        errors = [f"RMSE after {samples[k]} (°)" for k in shown]
        return {"": Table(["forward model", *errors, "query (ms)", "update (ms per sample)"], rows)}

"""Forward models arm → gaze, also of robots that are no chain of ideal joints; our iCub beside the official ones."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.reach.babbling import Babbled, babble
from learning.reach.forward_model import RevoluteArm
from pps_vision.experiments import charts
from pps_vision.experiments.baselines import jamone
from pps_vision.experiments.baselines.lwpr import LWPR
from pps_vision.experiments.baselines.regressors import ArmToGaze, ForwardModel, gaussian_process, quintic_spline
from pps_vision.experiments.reach_kinematics import deviations, official_icub
from pps_vision.experiments.reach_truth import N_TEST, first, gaze_rmse_deg
from pps_vision.experiments.study import Part, PartsStudy, SampledStudy, interval
from pps_vision.experiments.timing import timed, timed_steps
from pps_vision.robot.icub import load_icub

_N_TRIED = 20_000
_N_FIXATED_OF_J = 4400
_N_QUERIES = 50  # timed one by one
MODELS: dict[str, Callable[[], ForwardModel]] = {
    "model of revolute joints": RevoluteArm,
    "Gaussian process": lambda: ArmToGaze(gaussian_process()),
    "LWPR, each sample once": lambda: ArmToGaze(LWPR(4, 3, jamone.ARM_PARAMS)),
    "quintic spline (SciPy)": lambda: ArmToGaze(quintic_spline()),
}
_DEFAULT = "model of revolute joints"
_BASELINES = [name for name in MODELS if name != _DEFAULT]


def _forward_model(study: "ReachKinematics") -> dict[str, Any]:
    """Return by model a row for every number of samples, on 700 other postures: means over sets of postures."""
    robot = load_icub()
    repetitions: dict[str, list[list[dict[str, Any]]]] = {name: [] for name in MODELS}
    for seed in tqdm(study.seeds, desc="sets of postures", disable=None):
        rng = np.random.default_rng(seed)
        train = babble(robot, "right", _N_TRIED, rng)
        test = first(babble(robot, "right", 4 * N_TEST, rng), N_TEST)
        ends = zip((0, *study.sizes), study.sizes, strict=False)
        batches = [Babbled(train.arm_rad[low:high], train.gaze_rad[low:high], _N_TRIED) for low, high in ends]
        for name, make in MODELS.items():
            repetitions[name].append(learn_and_time(make(), batches, test))
    models = {name: [_mean_row(rows) for rows in zip(*sets, strict=True)] for name, sets in repetitions.items()}
    return {"samples": study.sizes, "methods": models}


def learn_and_time(model: ForwardModel, batches: list[Babbled], test: Babbled) -> list[dict[str, Any]]:
    """Return after each batch the RMSE (degrees), and the processor times of a query and of the update per sample.

    `ms` holds the quartiles of queries of one posture.
    """
    rows = []
    for batch in batches:
        _, learning_ms = timed(partial(model.learn, batch.arm_rad, batch.gaze_rad))
        _, fitting_ms = timed(partial(model, test.arm_rad[:1]))  # some models are fitted at their first query
        _, query_ms = timed_steps(model, test.arm_rad[:_N_QUERIES, None])
        rows.append(
            {
                "rmse_deg": gaze_rmse_deg(model, test)[0],
                "update_ms": (learning_ms + fitting_ms) / len(batch.arm_rad),
                "ms": np.percentile(query_ms, (25, 50, 75)).tolist(),
            }
        )
    return rows


def _mean_row(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Means of the same row of several sets of postures, and the 95 % interval of the RMSE."""
    means = {key: np.mean([row[key] for row in rows], axis=0).tolist() for key in rows[0]}
    return {**means, "rmse_deg": interval([[row["rmse_deg"]] for row in rows])}


def _forward_model_chart(numbers: dict[str, Any]) -> Figure:
    """Draw error over samples; time of a query and of an update against the error with all samples."""
    models = numbers["methods"]
    figure, (curves, query, update) = charts.panels(3, width=5.2)
    rmse = "gaze RMSE (°)"
    series = {name: [row["rmse_deg"] for row in rows] for name, rows in models.items()}
    charts.curves(curves, numbers["samples"], series, "fixated postures learned from", rmse)
    curves.plot(_N_FIXATED_OF_J, jamone.PUBLISHED["forward_model_deg"], "k*", ms=10, label="J's LWPR")
    curves.set(xscale="log", yscale="log", title="arm → gaze, learned by babbling (J Fig 2)")
    curves.legend(fontsize=7, loc=(0.4, 0.15))
    last = {name: rows[-1] for name, rows in models.items()}
    charts.speed_error(query, last, "rmse_deg", _BASELINES, _DEFAULT, "query of one posture (ms)", rmse)
    updates = {name: {**row, "ms": [row["update_ms"]] * 3} for name, row in last.items()}
    charts.speed_error(update, updates, "rmse_deg", _BASELINES, _DEFAULT, "update (ms per sample)", rmse)
    query.legend(fontsize=7)
    return figure


@dataclass(frozen=True)
class ReachKinematics(SampledStudy, PartsStudy):
    """Kinematics behind the reachable-space map."""

    PARTS: ClassVar[Mapping[str, Part]] = {
        "forward_model": Part(_forward_model, _forward_model_chart),
        "deviations": Part(lambda s: deviations.run(s.seeds, s.sizes[-1]), table=deviations.table),
        "official_icub": Part(lambda s: official_icub.run(s.official_models), table=official_icub.table),
    }
    SHORT: ClassVar[Mapping[str, Any]] = {"sizes": (100, 200)}

    n: int = 3  # sets of babbled postures, each with its own test set
    sizes: tuple[int, ...] = (100, 200, 400, 800, 1600, 3000, 4400)
    """Fixated postures after which each forward model is judged; of robots with deviations, the last one only."""
    official_models: tuple[str, ...] = ("iCubLisboa01", "iCubGazeboV2_5")
    """Official iCub models: of version 1, as ours, and of version 2.5."""

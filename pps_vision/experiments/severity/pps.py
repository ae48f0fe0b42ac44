"""Severity of seven disturbances of tracks, touches and training: where the learned map breaks."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from learning.pps.memory import MemoryParams, activation
from learning.pps.receptive_field import ReceptiveField
from pps_vision.experiments.baselines.single_taxel import (
    Paths,
    Simulation,
    count_paths,
    empty_map,
    from_taxel,
    sample_paths,
)
from pps_vision.experiments.charts import severities
from pps_vision.experiments.pps_prediction import auroc
from pps_vision.experiments.study import Axis, Break, Metric, Values, compare_severities, mean
from pps_vision.types import Array, Mask

HORIZON_S = 0.5
BREAKS = Break("auroc", 0.75, above=False)
PATCH = Simulation(taxels_m=tuple((0.03 * i, 0.03 * j) for i in range(-2, 3) for j in range(-2, 3)))
"""Skin of 15 × 15 cm with 25 virtual taxels: an object that touches some of them passes the others."""
MAPS = {
    "8×4 (R, default)": MemoryParams(),
    "16×8, σ 0.5 bin": MemoryParams(bins=(16, 8), sigma_bins=0.5),
    "distance only": MemoryParams(bins=(8, 1)),
}
_TEST_OBJECTS = 300


@dataclass(frozen=True)
class Disturbed:
    """Objects to train on and to test on, and their disturbance."""

    training: Simulation = PATCH
    test: Simulation = PATCH
    wrong_touches: float = 0.0  # share of training trials that report the touches of another trial
    missing: float = 0.0  # share of samples that are missing
    trials: int = 200  # number of training trials


def _noisy(mm: float) -> Simulation:
    return replace(PATCH, position_noise_m=mm / 1000, velocity_noise_m_s=2 * mm / 1000)


def _offset(cm: float) -> Simulation:
    return replace(PATCH, offset_m=cm / 100)


_CM = (0, 1, 2, 4, 6, 10)
_PERCENT = (0, 10, 20, 40, 60, 80, 95)
DISTURBANCES: dict[str, tuple[Axis, Callable[[float], Disturbed]]] = {
    "track noise": (Axis("σ (mm; 2σ mm/s)", (0, 5, 10, 20, 40, 80)), lambda s: Disturbed(_noisy(s), _noisy(s))),
    "offset outwards, in training too": (Axis("farther by (cm)", _CM), lambda s: Disturbed(_offset(s), _offset(s))),
    "offset outwards, after training": (Axis("farther by (cm)", _CM), lambda s: Disturbed(test=_offset(s))),
    "offset inwards, in training too": (Axis("nearer by (cm)", _CM), lambda s: Disturbed(_offset(-s), _offset(-s))),
    "missing samples": (Axis("missing (%)", (0, 25, 50, 75, 90, 97)), lambda s: Disturbed(missing=s / 100)),
    "wrong labels": (Axis("wrong taxels (%)", _PERCENT), lambda s: Disturbed(wrong_touches=s / 100)),
    "few trials": (Axis("training trials", (200, 100, 50, 20, 10, 5, 2)), lambda s: Disturbed(trials=int(s))),
}


class Samples(NamedTuple):
    """Training samples D, TTC (N, T, n) and `touched` (N, n); test samples D, TTC (N, n) and outcomes (N, n)."""

    D: Array
    TTC: Array
    touched: Mask
    test_D: Array
    test_TTC: Array
    outcome: Mask


def run(study: Any) -> dict[str, Any]:
    """Return the AUROC by disturbance and map; a map breaks where its AUROC falls below 0.75."""
    methods = {name: partial(score_map, params) for name, params in MAPS.items()}
    metrics = {"auroc": Metric("auroc", mean)}
    return {
        "disturbances": {
            name: compare_severities(partial(sample, disturb), axis, methods, metrics, study.seeds, BREAKS)
            for name, (axis, disturb) in DISTURBANCES.items()
            if name in (study.disturbances or DISTURBANCES)
        }
    }


def sample(disturb: Callable[[float], Disturbed], seed: int, severity: float) -> Samples:
    """Return disturbed training and test samples."""
    disturbed = disturb(severity)
    rng = np.random.default_rng(seed)
    training = sample_paths(disturbed.training, disturbed.trials, rng)
    test = sample_paths(disturbed.test, _TEST_OBJECTS, rng)
    D, TTC = _perceive(training, disturbed.missing, rng)
    is_wrong = rng.random(len(training.touched)) < disturbed.wrong_touches
    touched = np.where(is_wrong[:, None], training.touched[rng.permutation(len(training.touched))], training.touched)
    last = _last_known(*_perceive(test, disturbed.missing, rng), round(HORIZON_S / disturbed.test.step_s))
    return Samples(D, TTC, touched, *last, test.touched)


def score_map(params: MemoryParams, samples: Samples, seed: int) -> Values:
    """Return the AUROC of a map's predictions."""
    memory = count_paths(empty_map(samples.touched.shape[1], params), samples.D, samples.TTC, samples.touched)
    return {"auroc": [auroc(samples.outcome, activation(memory, samples.test_D, samples.test_TTC))]}


def _perceive(paths: Paths, missing: float, rng: np.random.Generator) -> tuple[Array, Array]:
    D, TTC = from_taxel(paths.d_m, paths.v_m_s, ReceptiveField())
    is_missing = rng.random((*D.shape[:2], 1)) < missing
    return np.where(is_missing, np.nan, D), np.where(is_missing, np.nan, TTC)


def _last_known(D: Array, TTC: Array, steps: int) -> tuple[Array, Array]:
    """The last perceived samples (N, n) at least `steps` before the end."""
    perceived = np.any(np.isfinite(D[:, : D.shape[1] - steps]), axis=2)
    last = np.where(perceived.any(axis=1), perceived.shape[1] - 1 - np.argmax(perceived[:, ::-1], axis=1), 0)
    rows = np.arange(len(D))
    return D[rows, last], TTC[rows, last]


def chart(numbers: dict[str, Any]) -> Figure:
    """Draw AUROC over severity, one panel a disturbance."""
    return severities(numbers["disturbances"], "auroc", f"AUROC {HORIZON_S} s ahead", BREAKS.bound, 4)

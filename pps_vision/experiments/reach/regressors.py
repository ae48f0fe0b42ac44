"""Which regressor should learn the arm-to-gaze forward model: time of a query and memory against error."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib import import_module
from time import process_time
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import RBFInterpolator
from tqdm import tqdm

from learning.reach.babbling import Babbled, score
from learning.reach.gaussian_process import GaussianProcess
from pps_vision.experiments.baselines.network import Network
from pps_vision.experiments.baselines.regressors import (
    ArmToGaze,
    FourierFeatures,
    Grid,
    LocalModels,
    Neighbours,
    Regressor,
)
from pps_vision.experiments.chart import Variant, legend, speed_against_error
from pps_vision.experiments.reach.forward_model import LWPR_OF_THE_ARM, babbled_sets
from pps_vision.experiments.study import Study
from pps_vision.types import Array

_N_TRAIN, _N_SINGLE, _N_RUNS, _LWPR_REPLAYS = 4400, 50, 5, 3
_LWPR_D = (5, 10, 30, 80, 200)  # about 100 to 10 000 receptive fields
_DEFAULT = "Gaussian process"
_PEERS = ("SciPy RBF, quintic", "boosted trees (scikit-learn)")


class ScipyRbf:
    """SciPy's quintic splines through all samples."""

    def __init__(self) -> None:
        self._rbf: RBFInterpolator | None = None

    def update(self, x: Array, y: Array) -> None:
        self._rbf = RBFInterpolator(x, y, kernel="quintic")
        self._n = len(x), x.shape[1] + y.shape[1]

    def predict(self, x: Array) -> Array:
        return np.asarray(self._rbf(x)) if self._rbf is not None else np.full((len(x), 3), np.nan)

    @property
    def nbytes(self) -> int:
        return 8 * self._n[0] * self._n[1]


class BoostedTrees:
    """scikit-learn's histogram-based gradient-boosted trees, one ensemble an output."""

    def __init__(self, seed: int) -> None:
        make = import_module("sklearn.ensemble").HistGradientBoostingRegressor
        self._trees = [make(max_iter=300, early_stopping=False, random_state=seed) for _ in range(3)]

    def update(self, x: Array, y: Array) -> None:
        for trees, values in zip(self._trees, y.T, strict=True):
            trees.fit(x, values)

    def predict(self, x: Array) -> Array:
        return np.stack([trees.predict(x) for trees in self._trees], axis=1)

    @property
    def nbytes(self) -> int:
        return sum(tree[0].nodes.nbytes for trees in self._trees for tree in trees._predictors)


class Replayed:
    """LWPR that sees each batch several times in random order."""

    def __init__(self, init_D: float, rng: np.random.Generator) -> None:
        self.models, self._rng = LocalModels(4, 3, replace(LWPR_OF_THE_ARM, init_D=init_D)), rng

    def update(self, x: Array, y: Array) -> None:
        for _ in range(_LWPR_REPLAYS):
            order = self._rng.permutation(len(x))
            self.models.update(x[order], y[order])

    def predict(self, x: Array) -> Array:
        return self.models.predict(x)

    @property
    def nbytes(self) -> int:
        return self.models.nbytes


def makers(seed: int) -> Mapping[str, Callable[[], Regressor]]:
    """Every regressor by name."""
    rng = partial(np.random.default_rng, seed)
    return {
        **{f"LWPR, D {D}": lambda D=D: Replayed(D, rng()) for D in _LWPR_D},  # type: ignore[misc]
        **{
            f"{n} Fourier features": lambda n=n: FourierFeatures(4, 3, n, 1.5, 1e-8, rng())  # type: ignore[misc]
            for n in (300, 1000, 3000)
        },
        "nearest neighbours": lambda: Neighbours(8),
        "grid 6⁴": lambda: Grid(4, 6, 1e-2),
        "grid 10⁴": lambda: Grid(4, 10, 1e-2),
        "network 64×64": lambda: Network(4, 3, rng()),
        _DEFAULT: GaussianProcess,
        _PEERS[0]: ScipyRbf,
        _PEERS[1]: lambda: BoostedTrees(seed),
    }


@dataclass(frozen=True)
class Measured:
    """Gaze RMSE of what it answers, and the share it does not; CPU microseconds to learn a sample and to answer a
    query, alone and among 700; memory."""

    rmse_deg: float
    unanswered: float
    learn_us: float
    query_us: float
    batch_us: float
    kib: float
    fields: int | None


def measure(make: Callable[[], Regressor], train: Babbled, test: Babbled) -> Measured:
    """Taught in one batch."""
    model = ArmToGaze(make())
    begun = process_time()
    model.learn(train.arm_rad, train.gaze_rad)
    model(test.arm_rad[:1])  # what learns when it is first asked
    learn = process_time() - begun
    runs = []
    for _ in range(_N_RUNS):
        begun = process_time()
        model(test.arm_rad)
        runs.append(process_time() - begun)
    begun = process_time()
    for arm in test.arm_rad[:_N_SINGLE]:
        model(arm[None])
    single, regressor = process_time() - begun, model.regressor
    error, unanswered = score(model, test)
    return Measured(
        rmse_deg=round(error, 4),
        unanswered=round(unanswered, 4),
        learn_us=round(1e6 * learn / len(train.arm_rad), 1),
        query_us=round(1e6 * single / _N_SINGLE, 1),
        batch_us=round(1e6 * min(runs) / len(test.arm_rad), 3),
        kib=round(regressor.nbytes / 1024, 1),
        fields=int(regressor.models.model.n_fields.sum()) if isinstance(regressor, Replayed) else None,
    )


@dataclass(frozen=True)
class Regressors(Study):
    """All of them on the same 4400 fixated postures, judged on the same 700."""

    seed: int = 0
    """Seed of the babbling."""

    def run(self) -> dict[str, Any]:
        """By regressor."""
        train, test = babbled_sets(self.seed)
        train = Babbled(train.arm_rad[:_N_TRAIN], train.gaze_rad[:_N_TRAIN], train.n_tried)
        found = {
            name: asdict(measure(make, train, test))
            for name, make in tqdm(makers(self.seed).items(), desc="regressors", disable=None)
        }
        return {"samples": len(train.arm_rad), "regressors": found}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Left the time of a query, right the memory, each against the error."""
        figure, (left, right) = plt.subplots(1, 2, figsize=(15, 7), layout="constrained")
        found = numbers["regressors"]
        for axis, key, scale in ((left, "query_us", 1e-3), (right, "kib", 1 / 1024)):
            variants = [
                Variant(
                    _label(name, m), np.full(3, scale * m[key]), m["rmse_deg"], name not in _PEERS, name == _DEFAULT
                )
                for name, m in found.items()
            ]
            speed_against_error(axis, variants, "query, alone", "gaze RMSE (°)")
            low, high = axis.get_xlim()
            axis.set_xlim(low, 4 * high)  # room for names
        right.set_xlabel("memory it learns with (MiB)")
        legend(right)
        figure.suptitle(f"Forward model arm → gaze from {numbers['samples']} babbled postures (n fields: LWPR)")
        return figure


def _label(name: str, measured: dict[str, Any]) -> str:
    label = name if measured["fields"] is None else f"{measured['fields']} fields"
    return f"{label} ({measured['unanswered']:.1%} unanswered)" if measured["unanswered"] else label

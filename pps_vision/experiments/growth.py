"""Processor time over the size of the image, the object, the skin and the map."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.pps.buffer import EventBuffer, push
from learning.pps.memory import MemoryParams, PPSMemory, activation, learn
from learning.pps.receptive_field import ReceptiveField, perceive
from learning.reach.params import MapParams
from learning.reach.training import train_reachable_map
from pps_vision.experiments.charts import curves, panels
from pps_vision.experiments.films.scenes import FOCAL, Film, FilmScene
from pps_vision.experiments.study import DATA, SampledStudy, quartiles
from pps_vision.experiments.timing import timed, timed_runs, timed_steps
from pps_vision.robot.icub import load_icub
from pps_vision.types import Array, TaxelEvents
from tracking.marker import MarkerParams
from tracking.tracker import Tracker, TrackerParams

OBJECTS_PX = (10, 25, 60, 143, 200, 400)
TAXELS = (100, 1000, 10_000, 100_000)
_DISTANCE_M = 0.6
_SETTLE_S = 1.0  # from the start of a film of 2 s, when the object is tracked
_RUNS = 20  # calls that take less than a frame
_GREEN: dict[str, Any] = {"color": (30.0, 200.0, 50.0)}
_GREEN_MARKER = TrackerParams("marker", marker=MarkerParams(127.0))
_REDUCED = TrackerParams(reduction=2)
_LIMBS = 8
_SAMPLES = 60  # 3 s at 50 ms
_FIELD = ReceptiveField(distance_to="surface")
_RADIUS_M = 0.035
_COV = 1e-6 * np.eye(3)

Call = Callable[[], Sequence[float]]  # returns one or more processor times (ms)


@dataclass(frozen=True)
class Growth(SampledStudy):
    """Image: films of a ball of the same angular size. Object: a ball 10–400 px across in images of 1280×720.
    Skin: perception of a ball near one taxel, and learning from 3 s. Map: training with true kinematics, and one query.

    The exponent is the slope of log time over log size between the two largest sizes.
    """

    MINUTES: ClassVar[int] = 14
    SHORT: ClassVar[Mapping[str, Any]] = {"images": ((320, 240),), "labels": (300, 600)}

    n: int = 3  # turns in which everything is timed at each size
    images: tuple[tuple[int, int], ...] = ((320, 240), (640, 480), (960, 720), (1280, 720), (1920, 1080))
    """Width and height of the images."""
    labels: tuple[int, ...] = (1000, 3000, 10_000, 30_000, 100_000)  # labels of the map
    data: Path = DATA
    """Folder of the photographs (default: PPS_VISION_DATA, else ../shared/data); procedural where they are absent."""

    def run(self) -> dict[str, Any]:
        """Return for each axis the sizes, and by series median and quartiles of the times at each."""
        axes = {
            "image (pixels)": self._over([math.prod(image) for image in self.images], self._image, self.images),
            "object (pixels across)": self._over(OBJECTS_PX, self._object),
            "skin (taxels)": self._over(TAXELS, self._skin),
            "map (labels)": self._over(self.labels, self._map),
        }
        return {"axes": axes}

    def _over(self, sizes: Sequence[int], make: Callable[[Any], dict[str, Call]], inputs: Sequence[Any] = ()) -> Any:
        """Time in turns the calls that `make` returns for each of the `inputs` (default: sizes)."""
        ms: dict[str, list[list[float]]] = {}
        for value in tqdm(inputs or sizes, desc=make.__name__.strip("_"), unit="size", disable=None):
            calls = make(value)
            turns = [{name: call() for name, call in calls.items()} for _ in range(self.n)]
            for name in calls:
                ms.setdefault(name, []).append(quartiles([time for turn in turns for time in turn[name]]))
        return {"sizes": list(sizes), "ms": ms}

    def _image(self, size: tuple[int, int]) -> dict[str, Call]:
        red = self._film(*size)
        return {
            "ball, all pixels": partial(red, TrackerParams()),
            "ball, pixels 2 × 2": partial(red, _REDUCED),
            "marker": partial(self._film(*size, **_GREEN), _GREEN_MARKER),
            "nothing moves": partial(self._film(*size, motion="still"), TrackerParams()),
        }

    def _object(self, across_px: int) -> dict[str, Call]:
        radius_m = 0.5 * across_px / (FOCAL * 1280) * _DISTANCE_M
        film = self._film(1280, 720, radius_m=radius_m, distance_m=_DISTANCE_M)
        return {"all pixels": partial(film, TrackerParams()), "pixels 2 × 2": partial(film, _REDUCED)}

    def _film(self, width: int, height: int, **options: Any) -> Callable[[TrackerParams], list[float]]:
        """Processor times (ms) of tracking the later pairs of a film."""
        film = Film(FilmScene(width=width, height=height, seconds=2.0, start="moving", **options), self.seed, self.data)
        frames = tuple(film)

        def track_film(params: TrackerParams) -> list[float]:
            _, ms = timed_steps(Tracker(params, film.rig, np.random.default_rng(0)).step, frames)
            return [t for t, frame in zip(ms, frames, strict=True) if frame.stamp_s >= _SETTLE_S]

        return track_film

    def _skin(self, taxels: int) -> dict[str, Call]:
        """A ball approaches the first taxel of eight cylindrical limbs, 30 cm long, 10 cm thick and 40 cm apart."""
        rng = np.random.default_rng(self.seed)
        limb = np.arange(taxels) * _LIMBS // taxels
        angle = rng.uniform(0, 2 * np.pi, taxels)
        height = rng.uniform(-0.15, 0.15, taxels)
        normals = np.stack([np.cos(angle), np.sin(angle), np.zeros(taxels)], axis=1)
        positions = 0.05 * normals + np.stack([0.4 * limb, np.zeros(taxels), height], axis=1)
        ids = tuple(f"limb{k}:{i}" for i, k in enumerate(limb))
        params = MemoryParams()
        memory = PPSMemory(ids, limb, rng.integers(0, 50, (taxels, *params.bins, 2)), params)
        velocity = -0.08 * normals[0]
        path = positions[0] - 0.05 * np.arange(_SAMPLES, 0, -1)[:, None] * velocity
        perceived = partial(perceive, _FIELD, positions, normals)
        buffer = EventBuffer()
        for k, p in enumerate(path):
            D, TTC = perceived(p, velocity)
            buffer = push(buffer, TaxelEvents(0.05 * k, ids, D, TTC, np.zeros(taxels, bool)))
        touched = np.arange(taxels) == 0

        def activations() -> Array:
            return activation(memory, *perceived(path[_SAMPLES // 2], velocity, _RADIUS_M, _COV))

        return {
            "one stimulus": partial(timed_runs, activations, _RUNS),
            "3 s learned": partial(timed_runs, partial(learn, memory, buffer, touched), _RUNS),
        }

    def _map(self, labels: int) -> dict[str, Call]:
        default = MapParams()
        params = replace(default, n_labels=labels, round_labels=min(default.round_labels, labels // 2), n_test=500)
        train = partial(train_reachable_map, load_icub(), "right", np.random.default_rng(self.seed), params)
        learned = train()
        query = partial(learned.query, learned.labels.gaze_rad[:1])
        return {"training": lambda: [timed(train)[1]], "one query": partial(timed_runs, query, _RUNS)}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw one panel for each axis; the exponent stands beside each name."""
        figure, axes = panels(len(numbers["axes"]), 2)
        for (label, cell), axis in zip(numbers["axes"].items(), axes, strict=True):
            series = {f"{name}: {exponent(cell['sizes'], ms):.2f}": ms for name, ms in cell["ms"].items()}
            curves(axis, cell["sizes"], series, label, "processor time (ms)")
            axis.set(xscale="log", yscale="log")
            axis.legend(fontsize=7, title="exponent", title_fontsize=7)
        return figure


def exponent(sizes: Sequence[float], ms: Sequence[Sequence[float]]) -> float:
    """Return the slope of the logarithm of the median time over that of the size between the two largest sizes."""
    if len(sizes) < 2:
        return np.nan
    return float(np.log(ms[-1][0] / ms[-2][0]) / np.log(sizes[-1] / sizes[-2]))

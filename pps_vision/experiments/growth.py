"""Cost as it grows: with the image, the object, the recording, the skin and the map."""

import math
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.pps.memory import learn
from learning.reach.params import MapParams
from learning.reach.training import train_reachable_map
from pps_vision.app.render import record
from pps_vision.app.render_params import RenderParams
from pps_vision.app.track import track
from pps_vision.experiments.charts import curves, panels
from pps_vision.experiments.films.scenes import Film, FilmScene
from pps_vision.experiments.study import DATA, NOISE_SIGMA, SampledStudy
from pps_vision.experiments.tables import Table, estimate, judged
from pps_vision.experiments.timing import quartiles, timed, timed_runs, timed_steps
from pps_vision.experiments.whole_skin import activations, buffer_at_touch, make_body
from pps_vision.geometry.camera import StereoRig
from pps_vision.recordings.open import open_recording
from pps_vision.robot.icub import load_icub
from pps_vision.types import StereoFrame
from tracking.marker import MarkerParams
from tracking.tracker import Tracker, TrackerParams

IMAGES = ((320, 240), (640, 480), (960, 720), (1280, 720), (1920, 1080))
OBJECTS_PX = (10, 25, 60, 143, 200, 400)
_GOAL_PX, _GOAL_MS = 200, 8.0
TAXELS = (100, 1000, 10_000, 100_000)
_OBJECTS_IN, _OBJECT = (1280, 720), "object (pixels across)"
_DISTANCE_M = 0.6
_SECONDS, _FOUND_S = 2.0, 1.0  # of a film; the object is tracked by then
_FILMED_S = 5.0  # of a recording that is played to and fro
_TESTED = 500  # postures that a map is tested on
_GREEN, _GREEN_DEG = (30.0, 200.0, 50.0), 127.0
_RUNS = 20  # of what takes less than a frame
_MB = 2**20

Times = list[float]
"""Milliseconds of as many runs or frames as there are."""


@dataclass(frozen=True)
class Growth(SampledStudy):
    """Processor time over the size of the image, the object, the recording, the skin and the reachable-space map.

    Image: films of a ball of the same angular size. Object: a ball 10–400 px across in images of 1280×720. Recording:
    one of 320×240 on disk that is played to and fro; opening it, tracking it up to a number of pairs, and the memory
    in use then. Skin: as `whole_skin`, the usual case. Map: training with true kinematics, and one query.
    The exponent is the slope of log time over log size between the two largest sizes.
    """

    SHORT: ClassVar[Mapping[str, Any]] = {"images": ((320, 240),), "pairs": (20, 40), "labels": (300, 600)}

    n: int = 3
    """Turns in which everything is timed at each size."""
    images: tuple[tuple[int, int], ...] = IMAGES
    """Width and height of the images."""
    pairs: tuple[int, ...] = (100, 1000, 10_000, 100_000)
    """Lengths of the recording."""
    labels: tuple[int, ...] = (1000, 3000, 10_000, 30_000, 100_000)
    """Labels of the map."""
    data: Path = DATA
    """Folder of the photographs (default: PPS_VISION_DATA, else ../shared/data); procedural where they are absent."""

    def run(self) -> dict[str, Any]:
        """Return for each axis the sizes, and by series median and quartiles of the times at each."""
        axes = {
            "image (pixels)": self._over(self._image, self.images, math.prod),
            _OBJECT: self._over(self._object, OBJECTS_PX),
            "recording (pairs)": self._recording(),
            "skin (taxels)": self._over(self._skin, TAXELS),
            "map (labels)": self._over(self._map, self.labels),
        }
        return {"axes": axes}

    def _over(
        self,
        make: Callable[[Any], dict[str, Callable[[], Times]]],
        of: Sequence[Any],
        size: Callable[[Any], int] = lambda one: one,
    ) -> Any:
        """Measure what `make` returns for each thing `of` some size, `n` times by turns."""
        ms: dict[str, list[list[float]]] = {}
        for one in tqdm(of, desc=make.__name__.strip("_"), unit="size", disable=None):
            calls = make(one)
            turns = [{name: call() for name, call in calls.items()} for _ in range(self.n)]
            for name in calls:
                ms.setdefault(name, []).append(quartiles([time for turn in turns for time in turn[name]]))
        return {"sizes": [size(one) for one in of], "ms": ms}

    def _image(self, size: tuple[int, int]) -> dict[str, Callable[[], Times]]:
        red, green, still = self._film(*size), self._film(*size, color=_GREEN), self._film(*size, motion="still")
        return {
            "ball, all pixels": partial(_per_pair, *red, TrackerParams()),
            "ball, pixels 2 × 2": partial(_per_pair, *red, TrackerParams(reduction=2)),
            "marker": partial(_per_pair, *green, TrackerParams("marker", marker=MarkerParams(_GREEN_DEG))),
            "nothing moves": partial(_per_pair, *still, TrackerParams()),
        }

    def _object(self, across_px: int) -> dict[str, Callable[[], Times]]:
        width, height = _OBJECTS_IN
        radius_m = 0.5 * across_px / (FilmScene().focal * width) * _DISTANCE_M
        film = self._film(width, height, radius_m=radius_m, distance_m=_DISTANCE_M)
        return {
            "all pixels": partial(_per_pair, *film, TrackerParams()),
            "pixels 2 × 2": partial(_per_pair, *film, TrackerParams(reduction=2)),
        }

    def _film(self, width: int, height: int, **what: Any) -> tuple[StereoRig, tuple[StereoFrame, ...]]:
        scene = FilmScene(width, height, seconds=_SECONDS, start="moving", **what)
        film = Film(scene, self.seed, self.data)
        return film.rig, tuple(film)

    def _recording(self) -> dict[str, Any]:
        opened: list[Times] = []
        tracked: list[Times] = []
        held: list[float] = []
        with TemporaryDirectory() as folder:
            short, long = Path(folder) / "short", Path(folder) / "long"
            record(RenderParams("ball", "circle", short, seconds=_FILMED_S, noise=NOISE_SIGMA, seed=self.seed))
            for pairs in tqdm(self.pairs, desc="recording", unit="size", disable=None):
                shutil.rmtree(long, ignore_errors=True)
                to_and_fro(short, long, pairs)
                opened.append([timed(partial(open_recording, long))[1] for _ in range(self.n)])
            recording = open_recording(long)
            for _ in range(self.n):
                begun, of_turn, in_use = process_time(), [], []
                for k, _ in enumerate(track(recording, seed=self.seed), start=1):
                    if k in self.pairs:
                        of_turn.append(1000 * (process_time() - begun))
                        in_use.append(_resident_mb())
                tracked.append(of_turn)
                held = held or in_use  # of the first turn, before which nothing was tracked
        tracking = [quartiles(turns) for turns in zip(*tracked, strict=True)]
        ms = {"opening": [quartiles(times) for times in opened], "tracking": tracking}
        return {"sizes": list(self.pairs), "ms": ms, "memory_mb": held}

    def _skin(self, taxels: int) -> dict[str, Callable[[], Times]]:
        body = make_body(taxels, np.random.default_rng(self.seed))
        felt = np.arange(taxels) == 0
        return {
            "one stimulus": partial(timed_runs, partial(activations, body), _RUNS),
            "3 s learned": partial(timed_runs, partial(learn, body.memory, buffer_at_touch(body), felt), _RUNS),
        }

    def _map(self, labels: int) -> dict[str, Callable[[], Times]]:
        robot, rng = load_icub(), np.random.default_rng(self.seed)
        params = replace(
            MapParams(), n_labels=labels, round_labels=min(MapParams().round_labels, labels // 2), n_test=_TESTED
        )
        learned = train_reachable_map(robot, "right", rng, params)
        return {
            "training": lambda: [timed(partial(train_reachable_map, robot, "right", rng, params))[1]],
            "one query": partial(timed_runs, partial(learned.query, learned.labels.gaze_rad[:1]), _RUNS),
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw one panel for each of what grows; the exponent stands beside each name."""
        figure, axes = panels(len(numbers["axes"]), 3)
        for (label, cell), axis in zip(numbers["axes"].items(), axes, strict=True):
            named = {f"{name}: {exponent(cell['sizes'], ms):.2f}": ms for name, ms in cell["ms"].items()}
            curves(axis, cell["sizes"], named, label, "processor time (ms)")
            axis.set(xscale="log", yscale="log")
            axis.legend(fontsize=7, title="exponent", title_fontsize=7)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return for every series the times at the smallest and the largest size, and the exponent."""
        rows = []
        for label, cell in numbers["axes"].items():
            sizes = cell["sizes"]
            for name, ms in cell["ms"].items():
                row = [f"{label}: {name}", str(sizes[0]), estimate(ms[0]), str(sizes[-1]), estimate(ms[-1])]
                rows.append([*row, f"{exponent(sizes, ms):.2f}"])
            if "memory_mb" in cell:
                first, last = (f"{cell['memory_mb'][k]:.0f} MB" for k in (0, -1))
                rows.append([f"{label}: memory in use", str(sizes[0]), first, str(sizes[-1]), last, "–"])
        header = ["what grows: what is timed", "from", "ms, quartiles", "to", "ms, quartiles", "exponent"]
        return {"": Table(header, rows), "object": _object_table(numbers["axes"][_OBJECT])}


def _object_table(cell: dict[str, Any]) -> Table:
    """Time at every size of the object, and the goal of all times at one of them, bold where it is missed."""
    sizes = cell["sizes"]
    goals = [f"≤ {_GOAL_MS:g}" if size == _GOAL_PX else "–" for size in sizes]
    times = [
        [judged(estimate(one), size == _GOAL_PX and one[0] > _GOAL_MS) for size, one in zip(sizes, ms, strict=True)]
        for ms in cell["ms"].values()
    ]
    rows = [list(row) for row in zip(map(str, sizes), *times, goals, strict=True)]
    header = [_OBJECT, *(f"{name}: ms, quartiles" for name in cell["ms"]), "goal (ms)"]
    return Table(header, rows)


def exponent(sizes: Sequence[float], ms: Sequence[Sequence[float]]) -> float:
    """Return the slope of the logarithm of the median time over that of the size between the two largest sizes."""
    if len(sizes) < 2:
        return np.nan
    return float(np.log(ms[-1][0] / ms[-2][0]) / np.log(sizes[-1] / sizes[-2]))


def _per_pair(rig: StereoRig, frames: Sequence[StereoFrame], params: TrackerParams) -> Times:
    """Processor times of the pairs of a film from when the object is found on."""
    tracker = Tracker(params, rig, np.random.default_rng(0))
    _, ms = timed_steps(tracker.step, frames)
    return [one for one, frame in zip(ms, frames, strict=True) if frame.stamp_s >= _FOUND_S]


def _resident_mb() -> float:
    """Memory of this process that is in use now."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / _MB


def to_and_fro(recording: Path, out: Path, pairs: int) -> None:
    """Write the recording of `recording`'s pairs, played forwards and backwards until there are so many; the images are
    those of the short one."""
    shutil.copytree(recording, out, copy_function=os.link)
    for log in sorted(recording.rglob("data.log")):
        (out / log.relative_to(recording)).unlink()
        lines = [line.split(" ", 2)[1:] for line in log.read_text().splitlines()]
        with (out / log.relative_to(recording)).open("w") as file:
            file.writelines(f"{k} {line}\n" for k, line in zip(range(pairs), _played(lines), strict=False))
    (out / "truth.csv").unlink()


def _played(lines: list[list[str]]) -> Iterator[str]:
    """The lines (stamp, rest) of a log forwards and backwards without end, with stamps that rise."""
    stamps_s = [float(stamp) for stamp, *_ in lines]
    length_s = stamps_s[-1] + stamps_s[1] - 2 * stamps_s[0]
    for turn in count():
        shown = lines if turn % 2 == 0 else lines[::-1]
        for at_s, (_, *rest) in zip(stamps_s, shown, strict=True):
            yield " ".join([f"{turn * length_s + at_s:.6f}", *rest])

"""Frame by frame or in batches on a device: when does it pay to search many frames at once?"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, process_time
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib.figure import Figure

from pps_vision.app.device import torch_device
from pps_vision.app.render import Render
from pps_vision.app.track import chunks
from pps_vision.experiments.chart import panels
from pps_vision.experiments.rendered import Rendered, rendered
from pps_vision.experiments.study import Study
from pps_vision.types import Array
from tracking.tracker import Tracker, TrackerParams, TrackerStep

if TYPE_CHECKING:
    from rendering.names import StimulusName

SIZES = (1, 4, 16, 64)
OBJECTS: dict[Literal["marker", "generic"], "StimulusName"] = {"marker": "marker", "generic": "ball"}


@dataclass(frozen=True)
class Batches(Study):
    """A rendered marker and a rendered ball followed frame by frame and by `track --device`: pairs per second against
    the size of the batch, with one and two threads and on a CUDA device where there is one, and how far the
    detections are apart."""

    n: int = 52
    """Stereo pairs of a recording."""
    recordings: int = 4
    """Recordings of each object."""
    repeats: int = 2
    """Runs over the recordings of every way, in turn."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    seed: int = 0
    """Seed of the first recording; each further one has the next."""

    def run(self) -> dict[str, object]:
        """Pairs per second (median and quartiles of the runs) and agreement, by the tracker's mode."""
        if self.repeats < 1 or self.n < 2 or self.recordings < 1:
            raise ValueError(
                f"bench batches: --repeats {self.repeats}, --n {self.n}, --recordings {self.recordings}; "
                "expected at least 1, 2 and 1"
            )
        return {mode: self._measure(mode, stimulus) for mode, stimulus in OBJECTS.items()}

    def _measure(self, mode: Literal["marker", "generic"], stimulus: "StimulusName") -> dict[str, object]:
        import torch  # takes seconds to load, and no other experiment needs it

        what = [
            Render(stimulus, "circle", Path(), seconds=self.n / 20, noise=self.noise, seed=self.seed + k)
            for k in range(self.recordings)
        ]
        films = [rendered(one) for one in what]
        cuda = torch.cuda.is_available()
        devices = [("cpu", 1), ("cpu", 2), *([("cuda", 1)] if cuda else [])]
        ways: dict[tuple[str, int], Callable[[], list[TrackerStep]]] = {
            ("frame by frame", 1): lambda: [step for film in films for step in follow(film, mode, self.seed)]
        }
        for name, threads in devices:
            for size in SIZES:
                ways[f"{name}, {threads} threads" if name == "cpu" else name, size] = (
                    lambda name=name, threads=threads, size=size: [  # type: ignore[misc]
                        step for film in films for step in follow_batched(film, mode, self.seed, name, size, threads)
                    ]
                )
        follow(films[0], mode, self.seed)  # loads and compiles what it needs
        for name, threads in devices:
            follow_batched(films[0], mode, self.seed, name, SIZES[-1], threads)
        steps: dict[tuple[str, int], list[TrackerStep]] = {}
        rates: dict[tuple[str, int], list[float]] = {way: [] for way in ways}
        for _ in range(self.repeats):
            for way, run in ways.items():
                clock = perf_counter if way[0] == "cuda" else process_time  # what a device does is no processor time
                start = clock()
                steps[way] = run()
                rates[way].append(len(steps[way]) / (clock() - start))
        alone = steps.pop(("frame by frame", 1))
        numbers: dict[str, object] = {"frame by frame": _rate(rates.pop(("frame by frame", 1)))}
        for name, size in rates:
            numbers.setdefault(name, {})[str(size)] = _rate(rates[name, size])  # type: ignore[index]
        if not cuda:
            numbers["cuda"] = "not measured: torch finds no CUDA device"
        pairs = [centers(film_steps) for film_steps in (alone, steps["cpu, 1 threads", SIZES[-1]])]
        truth = np.array([[row.left_px, row.right_px] for film in films for row in film.truth])
        every = [centers(film_steps) for film_steps in steps.values()]
        return {
            **numbers,
            "agreement": agreement(*pairs),
            "sizes_and_threads_at_most_apart_px": float(max(np.nanmax(np.abs(one - pairs[1])) for one in every)),
            "positions_at_most_apart_mm": 1000 * float(np.nanmax(_apart(alone, steps["cpu, 1 threads", SIZES[-1]]))),
            "error_frame_by_frame_px": _quantiles(np.linalg.norm(pairs[0] - truth, axis=-1)),
            "error_batch_px": _quantiles(np.linalg.norm(pairs[1] - truth, axis=-1)),
        }

    def chart(self, numbers: Mapping[str, Any]) -> Figure:
        """Pairs per second against the size of the batch."""
        figure, axes = panels(len(OBJECTS))
        for axis, mode in zip(axes, OBJECTS, strict=True):
            alone = numbers[mode]["frame by frame"]["median"]
            axis.axhline(alone, color="0.25", ls="--", lw=1)
            axis.annotate("frame by frame, no torch", (SIZES[0], alone), va="bottom", fontsize=8)
            for name, rates in numbers[mode].items():
                if isinstance(rates, dict) and set(rates) == set(map(str, SIZES)):
                    low, median, high = ([rates[str(size)][key] for size in SIZES] for key in ("q25", "median", "q75"))
                    axis.plot(SIZES, median, "o-", label=f"--device {name}")
                    axis.fill_between(SIZES, low, high, alpha=0.2)
            axis.set_xscale("log", base=2)
            axis.set_yscale("log")
            axis.set_xticks(SIZES, [str(size) for size in SIZES])
            axis.set_xlabel("stereo pairs in a batch")
            axis.set_ylabel("stereo pairs per second of processor time")
            axis.set_title(f"{OBJECTS[mode]} (--mode {mode})", fontsize=10)
            axis.grid(alpha=0.25, which="both")
            axis.legend(fontsize=8, loc="lower right")
        return figure


def follow(film: Rendered, mode: Literal["marker", "generic"], seed: int) -> list[TrackerStep]:
    """The tracker's steps, frame by frame."""
    tracker = Tracker(TrackerParams(mode), film.rig, np.random.default_rng(seed))
    return [tracker.step(frame) for frame in film.frames]


def follow_batched(
    film: Rendered, mode: Literal["marker", "generic"], seed: int, device: str, size: int, threads: int
) -> list[TrackerStep]:
    """The same in batches, with that many threads of torch."""
    from tracking.batch import BatchTracker

    with _threads(threads):
        tracker = Tracker(TrackerParams(mode), film.rig, np.random.default_rng(seed))
        batches = BatchTracker(tracker, torch_device(device))
        return [step for chunk in chunks(film.frames, size) for step in batches.steps(chunk)]


@contextmanager
def _threads(n: int) -> Iterator[None]:
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(n)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def centers(steps: list[TrackerStep]) -> Array:
    """(n, 2, 2) detected centres in the left and the right image, px; NaN where there is none."""
    found = np.full((len(steps), 2, 2), np.nan)
    for k, step in enumerate(steps):
        for one in step.detections:
            found[k, ("left", "right").index(one.camera)] = one.center_px
    return found


def agreement(one: Array, other: Array) -> dict[str, float]:
    """How far two series of detections (n, 2, 2) are apart, and how many only one of them has."""
    apart = np.linalg.norm(one - other, axis=-1)
    return {
        "detections": int(np.isfinite(one[..., 0]).sum()),
        "only_in_one": int((np.isnan(one[..., 0]) != np.isnan(other[..., 0])).sum()),
        **_quantiles(apart),
    }


def _quantiles(px: Array) -> dict[str, float]:
    median, most, largest = np.nanquantile(px, (0.5, 0.99, 1))
    return {"median_px": float(median), "q99_px": float(most), "max_px": float(largest)}


def _apart(one: list[TrackerStep], other: list[TrackerStep]) -> Array:
    """(n,) distance of the tracks, m; infinite where only one of them is known."""
    p, q = (np.array([step.track.position for step in steps]) for steps in (one, other))
    return np.where(np.isnan(p[:, 0]) == np.isnan(q[:, 0]), np.linalg.norm(p - q, axis=1), np.inf)


def _rate(rates: list[float]) -> dict[str, float]:
    q25, median, q75 = np.percentile(rates, (25, 50, 75))
    return {"median": float(median), "q25": float(q25), "q75": float(q75)}

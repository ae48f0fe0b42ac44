"""Frame by frame or in batches on a device: when does it pay to look for the marker in many frames at once?"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.figure import Figure

from pps_vision.app.render import Render
from pps_vision.app.track import chunks, marker_batches
from pps_vision.experiments import parameters
from pps_vision.experiments.chart import panels, timed
from pps_vision.experiments.rendered import Rendered, rendered
from pps_vision.types import Array
from tracking.tracker import Tracker, TrackerParams

SIZES = (1, 4, 16, 64)


class Batches(parameters.Batches):
    """The study of these parameters."""

    def run(self) -> dict[str, object]:
        """Pairs per second (median of the runs) by device and size of batch, and the paths' largest distance in mm."""
        if self.repeats < 1 or self.n < 2:
            raise ValueError(f"bench batches: --repeats {self.repeats}, --n {self.n}; expected at least 1 and 2")
        import torch  # seconds, which no other experiment needs

        what = Render("marker", "circle", Path(), seconds=self.n / 20, noise=self.noise, seed=self.seed)
        film = rendered(what)
        devices: list[Literal["cpu", "cuda"]] = ["cpu", "cuda"] if torch.cuda.is_available() else ["cpu"]
        ways: dict[tuple[str, int], Callable[[], Array]] = {("frame by frame", 1): lambda: follow(film, self.seed)}
        for device in devices:
            for size in SIZES:
                ways[device, size] = lambda d=device, s=size: follow_batched(film, self.seed, d, s)  # type: ignore[misc]
        rates: dict[tuple[str, int], list[float]] = {way: [] for way in ways}
        paths: dict[tuple[str, int], Array] = {}
        for device in devices:
            follow_batched(film, self.seed, device, SIZES[-1])  # loads and compiles what it needs
        for _ in range(self.repeats):
            for way, run in ways.items():
                paths[way], ms = timed(run)
                rates[way].append(1000 * len(film.frames) / ms)
        numbers: dict[str, object] = {"frame by frame": _rate(rates["frame by frame", 1])}
        for device in devices:
            numbers[device] = {str(size): _rate(rates[device, size]) for size in SIZES}
        if "cuda" not in devices:
            numbers["cuda"] = "skipped: torch finds no CUDA device"
        alone = paths["frame by frame", 1]
        numbers["paths_at_most_apart_mm"] = 1000 * max(float(np.nanmax(_apart(alone, path))) for path in paths.values())
        return numbers

    def chart(self, numbers: Mapping[str, Any]) -> Figure:
        """Pairs per second against the size of the batch."""
        figure, (axis,) = panels(1)
        axis.axhline(numbers["frame by frame"]["median"], color="0.25", ls="--", lw=1)
        axis.annotate(
            "frame by frame, no torch", (SIZES[0], numbers["frame by frame"]["median"]), va="bottom", fontsize=8
        )
        for device in ("cpu", "cuda"):
            if isinstance(numbers[device], dict):
                median, low, high = (
                    [numbers[device][str(size)][key] for size in SIZES] for key in ("median", "q25", "q75")
                )
                axis.plot(SIZES, median, "o-", label=f"--device {device}")
                axis.fill_between(SIZES, low, high, alpha=0.2)
        axis.set_xscale("log", base=2)
        axis.set_ylim(bottom=0)
        axis.set_xticks(SIZES, [str(size) for size in SIZES])
        axis.set_xlabel("stereo pairs a batch")
        axis.set_ylabel("stereo pairs per second")
        axis.grid(alpha=0.25, which="both")
        axis.legend(fontsize=8)
        return figure


def follow(film: Rendered, seed: int) -> Array:
    """(n, 3) the path frame by frame, NaN where it is not known."""
    tracker = Tracker(TrackerParams("marker"), film.rig, np.random.default_rng(seed))
    return np.array([tracker.step(frame).track.position for frame in film.frames])


def follow_batched(film: Rendered, seed: int, device: Literal["cpu", "cuda"], size: int) -> Array:
    """The same in batches."""
    tracker = Tracker(TrackerParams("marker"), film.rig, np.random.default_rng(seed))
    find, path = marker_batches(tracker, device), []
    for chunk in chunks(film.frames, size):
        path += [tracker.step(f, seen).track.position for f, seen in zip(chunk, find(chunk), strict=True)]
    return np.array(path)


def _apart(one: Array, other: Array) -> Array:
    """(n,) m; infinite where only one of them is known."""
    apart = np.linalg.norm(one - other, axis=1)
    return np.where(np.isnan(one[:, 0]) == np.isnan(other[:, 0]), apart, np.inf)


def _rate(rates: list[float]) -> dict[str, float]:
    q25, median, q75 = np.percentile(rates, (25, 50, 75))
    return {"median": float(median), "q25": float(q25), "q75": float(q75)}

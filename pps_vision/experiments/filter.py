"""How much a filter's order, its choice, its gain and a look back are worth, on rendered motion and on real flights."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pps_vision.experiments import filter_methods as methods
from pps_vision.experiments.chart import Variant, legend, panels, speed_against_error, timed
from pps_vision.experiments.filter_methods import State
from pps_vision.experiments.filter_scenes import (
    SETTLED,
    Sequence,
    approach_sequences,
    flights,
    rendered_sequences,
    simulated_sequences,
)
from pps_vision.experiments.study import DATA, Study
from pps_vision.types import Array, Mask
from tracking.names import DEFAULT_ORDER

SPEEDS_M_S = (0.05, 0.1, 0.2, 0.3)
DEFAULT = f"order {DEFAULT_ORDER}"
PEERS = ("cv2", "filterpy", "filterpy, RTS")
_ORDERS = (1, 2, 3, 4)
Online = Callable[[Sequence], methods.Filter]
Smoothed = Callable[[Sequence], list[State]]


@dataclass(frozen=True)
class Filter(Study):
    """Filters of orders 1–4, of automatic order, with constant gain, with and without RTS smoothing, and peers.

    On the measurements of rendered balls and markers (noisy images, head moving), and on tt3d's noisy flights,
    where that folder is.  filterpy is skipped where it is not installed.
    """

    n: int = 1
    """Recordings of each object on each motion, and of each at each speed of approach."""
    seconds: float = 5.0
    """Length of the recordings that are no approaches."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    data: Path = DATA
    """Folder that holds tt3d (default: PPS_VISION_DATA, else ../shared/data)."""
    seed: int = 0
    """Seed of the first recordings; the others count up."""

    def run(self) -> dict[str, object]:
        """By data and filter: milliseconds an update, RMS errors of position and velocity, median error of the
        time to contact in the last half second before a touch; of fast simulated motion the orders' velocity only."""
        if self.n < 1 or self.seconds < 1:
            raise ValueError(f"bench filter: --n {self.n}, --seconds {self.seconds}; expected at least 1 of each")
        in_the_air = rendered_sequences(self.n, self.seconds, self.noise, self.seed)
        onto_skin = approach_sequences(self.n, SPEEDS_M_S, self.noise, self.seed)
        folder = self.data / "tt3d"
        return {
            "rendered": compare([*in_the_air, *onto_skin], *rendered_filters(), settled=SETTLED),
            "tt3d": compare(flights(folder), *flight_filters(), settled=0)
            if folder.exists()
            else f"skipped: no {folder}",
            "simulated": {f"{fps} images/s": simulated(20, fps, self.seed) for fps in (20, 60)},
            "filterpy": "compared" if find_spec("filterpy") else "skipped: not installed (extra: test)",
        }

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Rendered motion, forward and with the way back: three errors each; flights: position."""
        of = numbers["rendered"]
        figures = {
            "rendered": _chart([(of, key, label, False) for key, label in _RENDERED_ERRORS.items()]),
            "smoothed": _chart([(of, key, f"{label}, smoothed", True) for key, label in _RENDERED_ERRORS.items()]),
        }
        if isinstance(numbers["tt3d"], dict):
            label = "position error on tt3d (mm RMS)"
            figures["tt3d"] = _chart(
                [(numbers["tt3d"], "position_rms_mm", label + also, bool(also)) for also in ("", ", smoothed")]
            )
        return figures


def simulated(n: int, fps: float, seed: int) -> dict[str, dict[str, float]]:
    """Velocity error, mm/s RMS, by fast motion and order."""
    sequences, found = simulated_sequences(n, fps, seed), {}
    online = {f"order {order}": partial(methods.Ours, order) for order in _ORDERS[1:]}
    for name in {sequence.name: None for sequence in sequences}:
        errors = compare([one for one in sequences if one.name == name], online, {}, settled=SETTLED)
        found[name] = {order: errors[order]["velocity_rms_mm_s"] for order in online}
    return found


def rendered_filters() -> tuple[dict[str, Online], dict[str, Smoothed]]:
    """What runs on rendered motion: forward, and forward and back."""
    online: dict[str, Online] = {f"order {order}": partial(methods.Ours, order) for order in _ORDERS}
    smoothed: dict[str, Smoothed] = {f"order {o}, RTS": partial(methods.smoothed_ours, o) for o in _ORDERS}
    online |= {"automatic order": methods.Automatic, "constant gain": methods.Steady, "cv2": methods.OpenCV}
    smoothed |= {"constant gain, RTS": methods.smoothed_steady}
    if find_spec("filterpy"):
        online["filterpy"] = methods.FilterPy
        smoothed["filterpy, RTS"] = methods.smoothed_filterpy
    return online, smoothed


def flight_filters() -> tuple[dict[str, Online], dict[str, Smoothed]]:
    """The same and the flight model."""
    online, smoothed = rendered_filters()
    return {**online, "flight": methods.Flight}, {**smoothed, "flight, RTS": methods.smoothed_flight}


def compare(
    sequences: list[Sequence], online: Mapping[str, Online], smoothed: Mapping[str, Smoothed], settled: int
) -> dict[str, Any]:
    """Errors and times by filter; every filter takes each measurement before the next comes."""
    names = [*online, *smoothed]
    ms: dict[str, list[float]] = {name: [] for name in names}
    states: dict[str, list[list[State]]] = {name: [] for name in ["as measured", *names]}
    for sequence in sequences:
        filters = {name: make(sequence) for name, make in online.items()}
        paths: dict[str, list[State]] = {name: [sequence.positions[:1]] for name in online}
        rows = zip(sequence.stamps_s[1:], sequence.positions[1:], sequence.covs[1:], strict=True)
        for stamp_s, position, cov in rows:
            for name, one in filters.items():
                state, spent = timed(partial(one.step, float(stamp_s), position, cov))
                paths[name].append(state.copy())
                ms[name].append(spent)
        for name, whole in smoothed.items():
            paths[name], spent = timed(partial(whole, sequence))
            ms[name].append(spent / len(sequence.stamps_s))
        paths["as measured"] = [position[None] for position in sequence.positions]
        for name, path in paths.items():
            states[name].append(path)
    result: dict[str, Any] = {name: _errors(sequences, path, settled) for name, path in states.items()}
    for name in names:
        q25, median, q75 = (round(float(q), 5) for q in np.percentile(ms[name], (25, 50, 75)))
        result[name] |= {"q25_ms": q25, "median_ms": median, "q75_ms": q75}
    return result


def _errors(sequences: list[Sequence], paths: list[list[State]], settled: int) -> dict[str, float]:
    position, velocity, ttc = [], [], []
    for sequence, path in zip(sequences, paths, strict=True):
        p = np.array([state[0] for state in path])
        position.append(np.sum((p - sequence.path)[settled:] ** 2, axis=1))
        if len(path[-1]) < 2:
            continue
        v = np.array([state[1] if len(state) > 1 else np.zeros(3) for state in path])
        calm = ~sequence.jumped & (np.arange(len(p)) >= settled)
        velocity.append(np.sum((v - sequence.velocity)[calm] ** 2, axis=1))
        ttc.append(_ttc_error(sequence, p, v, sequence.late & calm))
    return {
        "position_rms_mm": 1000 * _rms(position),
        "velocity_rms_mm_s": 1000 * _rms(velocity),
        "ttc_median_percent": 100 * float(np.median(np.concatenate(ttc))) if sum(map(len, ttc)) else np.nan,
    }


def _ttc_error(sequence: Sequence, p: Array, v: Array, at: Mask) -> Array:
    """Relative error of the time until the surface (of the true radius) is at the point it touches, where `at`."""
    line = p[at] - sequence.touched
    distance = np.linalg.norm(line, axis=1)
    closing = -np.einsum("ij,ij->i", line, v[at]) / distance
    ttc = np.where(closing > 0, (distance - sequence.radius_m) / np.where(closing > 0, closing, 1.0), np.inf)
    return np.abs(ttc / sequence.ttc_s[at] - 1)


def _rms(squares: list[Array]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(squares)))) if squares else np.nan


_RENDERED_ERRORS = {
    "position_rms_mm": "position error (mm RMS)",
    "velocity_rms_mm_s": "velocity error (mm/s RMS)",
    "ttc_median_percent": "TTC error, last 0.5 s (median, %)",
}


def _chart(plots: list[tuple[dict[str, Any], str, str, bool]]) -> Figure:
    """A panel for each of (numbers, which error, its label, whether of the smoothed)."""
    figure, axes = panels(len(plots), width=5.6, height=4.6)
    for axis, (numbers, key, label, smoothed) in zip(axes, plots, strict=True):
        errors = {name: np.nan if of[key] is None else of[key] for name, of in numbers.items()}
        variants = [
            Variant(
                name.removeprefix("order ").removesuffix(", RTS").removesuffix(" order"),
                np.array([of["q25_ms"], of["q25_ms"], of["median_ms"], of["q75_ms"], of["q75_ms"]]),
                errors[name],
                ours=name not in PEERS,
                default=name == DEFAULT,
            )
            for name, of in numbers.items()
            if name != "as measured" and name.endswith(", RTS") == smoothed and np.isfinite(errors[name])
        ]
        raw = errors["as measured"]
        speed_against_error(axis, variants, "update", label, ("as measured", raw) if np.isfinite(raw) else None)
        finite = [error for error in errors.values() if np.isfinite(error)]
        axis.set_yscale("log")
        axis.set_ylim(0.7 * min(finite), 1.5 * max(finite))  # the same for both ways
        axis.set_xlim(right=4 * max(float(np.median(v.ms)) for v in variants))  # room for names
    legend(axes[-1])
    return figure

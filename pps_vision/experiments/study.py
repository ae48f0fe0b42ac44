"""Base classes of the studies, their catalogue, and measurement and statistics of methods.

A study is a module, or a package, directly in `pps_vision/experiments` that holds exactly one frozen dataclass derived
from `Study`. `pps-vision bench` finds it there by the module's name; the summary is the module's docstring.
"""

import inspect
import operator
import os
import pkgutil
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from tqdm import tqdm

from pps_vision import experiments
from pps_vision.errors import InputError
from pps_vision.experiments.timing import timed
from pps_vision.types import Array, Mask

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pps_vision.experiments.tables import Table

DATA = Path(os.environ.get("PPS_VISION_DATA", "../shared/data"))
"""Folder of the real data (default of every field `data`)."""
NOISE_SIGMA = 2.0  # pixel noise of the recordings, grey levels of 255, unless it is varied

SceneSource = Literal["rendered", "independent"]
Scenes = Literal["rendered", "independent", "both"]

Values = Mapping[str, ArrayLike]  # A method's measurements on one recording: any number of values by quantity
Method = Callable[[Any, int], Values]  # A method takes a recording and a seed

TURNS = 3  # alternating repetitions of each method where times are compared
_RESAMPLES = 1000
_MINIMA = {"seed": 0, "seconds": 0.1, "share": 0.01}
_SHORT = {"n": 1, "seconds": 2.0, "n_labels": 600, "n_test": 500, "share": 0.2}  # of every study that has them


@dataclass(frozen=True)
class Study(ABC):
    """Base of the studies, which are frozen dataclasses of parameters.

    Raises:
        InputError: A parameter is below what any study can do with.
    """

    SHORT: ClassVar[Mapping[str, Any]] = {}
    """Parameters of a short run, which shows that the study works but measures nothing."""
    MINUTES: ClassVar[int] = 0
    """How long a run takes on one core; of several studies the longest start first."""

    seed: int = 0  # seed; recordings, robots and simulations count up from it

    def __post_init__(self) -> None:
        """Check the parameters: counts (all whole numbers but the seed), seed, seconds and shares."""
        for name, value in vars(self).items():
            minimum = _MINIMA.get(name, 1 if type(value) is int else None)
            if minimum is not None and not value >= minimum:
                raise InputError(f"bench {self.name()}", f"--{name} {value}; expected at least {minimum:g}")

    @classmethod
    def name(cls) -> str:
        """Return the study's name, which is its module's."""
        return cls.__module__.removeprefix(f"{experiments.__name__}.")

    @classmethod
    def summary(cls) -> str:
        """Return the first paragraph of the module's docstring."""
        paragraph, _, _ = (inspect.getmodule(cls).__doc__ or "").partition("\n\n")
        return paragraph.strip().replace("\n", " ")

    @classmethod
    def defaults(cls) -> dict[str, Any]:
        """Return the parameters with their defaults."""
        return {field.name: field.default for field in fields(cls)}

    @classmethod
    def short(cls) -> dict[str, Any]:
        """Return the parameters of a short run."""
        common = {name: value for name, value in _SHORT.items() if name in cls.defaults()}
        return {**common, **cls.SHORT}

    @abstractmethod
    def run(self) -> dict[str, Any]:
        """Measure and return the numbers of the result file."""

    def chart(self, numbers: dict[str, Any]) -> "Figure | dict[str, Figure]":
        """Draw the numbers of the result file: one chart, or several by name."""
        return {}

    def tables(self, numbers: dict[str, Any]) -> "dict[str, Table]":
        """Return the tables for the documents by name; the name "" is the study's own."""
        return {}


class Part(NamedTuple):
    """One part of a study: functions that measure it (from the study's parameters), draw it and tabulate it; whether it
    runs only on request, by its name.

    A chart or table is the part's own, or several by name. `chart` and `table` are given the part's numbers, and are
    not called where the part was skipped: where `run` returned {"skipped": the reason}.
    """

    run: Callable[[Any], dict[str, Any]]
    chart: "Callable[[dict[str, Any]], Figure | dict[str, Figure]] | None" = None
    table: "Callable[[dict[str, Any]], Table | dict[str, Table]] | None" = None
    on_request: bool = False


@dataclass(frozen=True)
class PartsStudy(Study):
    """Base of the studies of several parts, each measured, drawn and tabulated for itself.

    The result file holds each part's numbers under its name, with the parameters, machine and time of its run; figures
    are `STUDY_part.png` and `STUDY_part_name.png`, tables `STUDY_part` and `STUDY_part_name`.

    Raises:
        InputError: A part is not one of the study's.
    """

    PARTS: ClassVar[Mapping[str, Part]] = {}  # the parts by name

    parts: tuple[str, ...] = ()  # parts to run (default: all but those on request)

    def __post_init__(self) -> None:
        """Check the parameters and the names of parts."""
        super().__post_init__()
        for part in self.parts:
            if part not in self.PARTS:
                raise InputError(f"bench {self.name()}", f"--parts {part}; expected of {', '.join(self.PARTS)}")

    def tasks(self) -> dict[str, Callable[[], dict[str, Any]]]:
        """Return what measures each chosen part."""
        chosen = self.parts or [name for name, part in self.PARTS.items() if not part.on_request]
        return {name: partial(part.run, self) for name, part in self.PARTS.items() if name in chosen}

    def run(self) -> dict[str, Any]:
        """Return the numbers of each part."""
        return {name: task() for name, task in self.tasks().items()}

    def chart(self, numbers: dict[str, Any]) -> "dict[str, Figure]":
        """Draw the parts that were measured."""
        return self._by_part("chart", numbers)

    def tables(self, numbers: dict[str, Any]) -> "dict[str, Table]":
        """Return the tables of the parts that were measured."""
        return self._by_part("table", numbers)

    def _by_part(self, kind: str, numbers: dict[str, Any]) -> dict[str, Any]:
        """Charts or tables of the measured parts, by "part" or "part_name"."""
        results: dict[str, Any] = {}
        for part, functions in self.PARTS.items():
            function = getattr(functions, kind)
            if function is not None and "skipped" not in numbers.get(part, {"skipped": ""}):
                result = function(numbers[part])
                named = result if isinstance(result, dict) else {"": result}
                results |= {f"{part}_{name}" if name else part: value for name, value in named.items()}
        return results


@dataclass(frozen=True)
class SampledStudy(Study):
    """Base of the studies that repeat a measurement on independent units."""

    n: int = 4  # independent units of each kind: recordings, robots or simulations

    @property
    def seeds(self) -> range:
        """One seed a unit."""
        return range(self.seed, self.seed + self.n)


@dataclass(frozen=True)
class TrackingStudy(SampledStudy):
    """Base of the studies on recordings of a moving object, from one or both scene sources."""

    scenes: Scenes = "both"  # rendered scenes, independent ones, or both

    @property
    def sources(self) -> tuple[SceneSource, ...]:
        """The chosen scene sources."""
        return ("rendered", "independent") if self.scenes == "both" else (self.scenes,)

    def scenarios(self, make: Callable[..., Any], kinds: Sequence[str]) -> dict[str, Callable[..., Any]]:
        """Return functions of a seed that call `make(kind, source, seed)`, by "source, kind"."""
        return {f"{source}, {kind}": partial(make, kind, source) for source in self.sources for kind in kinds}


class Metric(NamedTuple):
    """`summary` of the `values` of all recordings together, e.g. `Metric("position_mm", rms)`."""

    values: str
    summary: Callable[[Array], float]


class Axis(NamedTuple):
    """The varied quantity of a severity study: name with unit, and values, the first undisturbed."""

    label: str
    severities: Sequence[float]


class Break(NamedTuple):
    """A method breaks at the first severity where `metric` is above (or below) `bound`, or does not exist."""

    metric: str
    bound: float
    above: bool = True


def rms(values: Array) -> float:
    """Return the root mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else np.nan


def mean(values: Array | Mask) -> float:
    """Return the mean (the share, of booleans); NaN of nothing."""
    return float(np.mean(values)) if len(values) else np.nan


def median(values: Array) -> float:
    """Return the median; NaN of nothing."""
    return float(np.median(values)) if len(values) else np.nan


def quartiles(values: Sequence[float] | Array) -> list[float]:
    """Return the median with the lower and the upper quartile; NaN of nothing."""
    return np.percentile(values, (50, 25, 75)).tolist() if len(values) else [np.nan] * 3


def percent(values: Array | Mask) -> float:
    """Return 100 times the mean; NaN of nothing."""
    return 100 * mean(values)


def measure(
    scenarios: Mapping[str, Callable[[int], Any]],
    methods: Mapping[str, Method],
    seeds: Sequence[int],
    repeated: int = 1,
) -> dict[str, dict[str, list[Values]]]:
    """Run every method on every recording; return the values by scenario and method, one item per seed.

    `scenarios` make a recording from a seed. A method that does not return its own "ms" (one value a frame) gets the
    processor time of the whole run. With `repeated` above 1 the methods run alternately, each that often, and "ms" has
    the times of all runs.
    """
    measured: dict[str, dict[str, list[Values]]] = {}
    for scenario, make in scenarios.items():
        cells: dict[str, list[Values]] = {method: [] for method in methods}
        for seed in tqdm(seeds, desc=scenario, unit="recording", disable=None):
            recording = make(seed)
            runs = {name: partial(run, recording, seed) for name, run in methods.items()}
            turns = [{name: timed(run) for name, run in runs.items()} for _ in range(repeated)]
            for method in methods:
                ms = [np.atleast_1d(values.get("ms", ms)) for values, ms in (turn[method] for turn in turns)]
                cells[method].append({**turns[0][method][0], "ms": np.concatenate(ms)})
        measured[scenario] = cells
    return measured


def summarize(
    recordings: Mapping[str, Sequence[Values]], metrics: Mapping[str, Metric], reference: str | None = None
) -> dict[str, dict[str, Any]]:
    """Return by method: every metric as [value, low, high], median and quartiles of "ms", its ratio to `reference`, n.

    The 95 % intervals come from resampling recordings, the independent units.
    """
    summaries: dict[str, dict[str, Any]] = {}
    for method, values in recordings.items():
        cell: dict[str, Any] = {"n": len(values)}
        if all("ms" in recording for recording in values):
            cell["ms"] = quartiles(np.concatenate([np.atleast_1d(recording["ms"]) for recording in values]))
            if reference is not None:
                pairs = zip(values, recordings[reference], strict=True)
                ratios = [[np.divide(*(np.median(np.asarray(run["ms"])) for run in pair))] for pair in pairs]
                cell["ratio"] = interval(ratios, median)
        for name, metric in metrics.items():
            cell[name] = interval([np.atleast_1d(v.get(metric.values, ())) for v in values], metric.summary)
        summaries[method] = cell
    return summaries


def interval(units: Sequence[ArrayLike], summary: Callable[[Array], float] = mean) -> list[float]:
    """Return [value, low, high] of `summary` over all values, with the 95 % interval by resampling the `units`.

    Units are independent, such as recordings, seeds or subjects; each may hold several values or none.
    """
    arrays = [np.asarray(unit, dtype=float) for unit in units]
    if not arrays:
        return [np.nan] * 3
    draws = np.random.default_rng(0).integers(len(arrays), size=(_RESAMPLES, len(arrays)))
    resampled = [summary(np.concatenate([arrays[k] for k in draw])) for draw in draws]
    ends = [np.nan] * 2 if np.all(np.isnan(resampled)) else np.nanpercentile(resampled, (2.5, 97.5)).tolist()
    return [summary(np.concatenate(arrays)), *ends]


def compare(
    scenarios: Mapping[str, Callable[[int], Any]],
    methods: Mapping[str, Method],
    metrics: Mapping[str, Metric],
    seeds: Sequence[int],
    reference: str | None = None,
    repeated: int = 1,
) -> dict[str, dict[str, dict[str, Any]]]:
    """Measure and summarize every method on every scenario: numbers[scenario][method][metric] = [value, low, high]."""
    measured = measure(scenarios, methods, seeds, repeated)
    return {scenario: summarize(cells, metrics, reference) for scenario, cells in measured.items()}


def compare_severities(
    scenario: Callable[[int, float], Any],
    axis: Axis,
    methods: Mapping[str, Method],
    metrics: Mapping[str, Metric],
    seeds: Sequence[int],
    breaks: Break,
) -> dict[str, Any]:
    """Measure every method at each severity of one disturbance, which `scenario` makes from a seed and a severity.

    Returns "axis", "severities", and by method each metric as a list of [value, low, high] and "breaks_at".
    """
    scenarios = {f"{axis.label} {s:g}": lambda seed, s=s: scenario(seed, s) for s in axis.severities}
    rows = list(compare(scenarios, methods, metrics, seeds).values())
    by_method: dict[str, dict[str, Any]] = {
        m: {name: [row[m][name] for row in rows] for name in metrics} for m in methods
    }
    is_within = operator.le if breaks.above else operator.ge
    for cell in by_method.values():
        pairs = zip(axis.severities, cell[breaks.metric], strict=True)
        cell["breaks_at"] = next((s for s, (value, _, _) in pairs if not is_within(value, breaks.bound)), None)
    return {"axis": axis.label, "severities": list(axis.severities), "methods": by_method}


@cache
def catalogue() -> dict[str, type[Study]]:
    """Return the class of every study by the study's name."""
    studies = {}
    for info in pkgutil.iter_modules(experiments.__path__, f"{experiments.__name__}."):
        for value in vars(import_module(info.name)).values():
            is_study = inspect.isclass(value) and issubclass(value, Study)
            if is_study and value.__module__ == info.name != __name__:
                studies[value.name()] = value
    return studies

"""How much each constant of the tracker matters: 0.7 and 1.4 times as large, on films it was not chosen on."""

import ast
import pkgutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass, replace
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

import tracking
from pps_vision.experiments.independent_cases import CASES, Case
from pps_vision.experiments.independent_films import Film
from pps_vision.experiments.independent_score import mean_score, scored
from pps_vision.experiments.study import DATA, Study
from pps_vision.experiments.tables import Table
from pps_vision.types import StereoFrame
from tracking.tracker import TrackerParams

FACTORS = (0.7, 1.4)
JUDGED = {"right": "right_percent", "false claims": "false_percent", "95 % ellipsoid": "covered_percent"}
_OTHER_METHODS = ("tracking.track2d", "tracking.batch", "tracking.smoother")
_LAYOUT = ("appearance.N_BINS", "appearance._BITS")  # of tables that other numbers must fit
FILMED = (  # of each kind of difficulty one; with more films the study takes more than half an hour
    "vivid, red",
    "grey, entering",
    "textured square",
    "behind a board for 1 s",
    "noise 10",
    "head moves, 10 ms stale",
    "marker, whole sensor chain",
)
Scores = list[dict[str, float]]


@dataclass(frozen=True)
class Constants(Study):
    """Each constant of the tracker 0.7 and 1.4 times as large: right, false claims and coverage on independent scenes.

    Constants are the numbers of `TrackerParams` and of the modules of `tracking` that track in 3D; not varied are those
    that compiled functions have built in.  One film of each case; a difference is the mean over the films of
    the score with the changed constant less that with the default.
    """

    SHORT: ClassVar[Mapping[str, Any]] = {"cases": ("vivid, red",), "only": "confirm_frames"}

    seed: int = 0
    """Seed of the first film; the others count up."""
    data: Path = DATA
    """Folder of the photographs (default: PPS_VISION_DATA, else ../shared/data); procedural where they are absent."""
    cases: tuple[str, ...] = FILMED
    """Cases of `bench independent` that are filmed."""
    only: str = ""
    """Only the constants whose names contain this."""

    def run(self) -> dict[str, Any]:
        """By constant and factor: differences from the default in percentage points, and of how many films."""
        cases = [case for case in CASES if case.name in self.cases]
        films = [Film(case.scene(k), self.seed + k, self.data) for k, case in enumerate(cases)]
        filmed = [(case, film, list(film)) for case, film in zip(cases, films, strict=True)]
        default = self._scores(filmed, TrackerParams())
        found: dict[str, Any] = {}
        chosen = [name for name in [*module_constants(), *parameters(TrackerParams())] if self.only in name]
        for name in tqdm(chosen, desc="constants", disable=None):
            found[name] = {str(factor): differences(self._changed(filmed, name, factor), default) for factor in FACTORS}
        return {"default": mean_score(default), "films": len(films), "constants": found}

    def _changed(self, filmed: list[tuple[Case, Film, list[StereoFrame]]], name: str, factor: float) -> Scores | None:
        """The scores with one constant changed; None where the tracker refuses the value."""
        try:
            if name in module_constants():
                with scaled(name, factor):
                    return self._scores(filmed, TrackerParams())
            return self._scores(filmed, with_parameter(TrackerParams(), name, factor))
        except ValueError:
            return None

    def _scores(self, filmed: list[tuple[Case, Film, list[StereoFrame]]], params: TrackerParams) -> Scores:
        scores = []
        for case, film, frames in filmed:
            of_case = case.tracker(film.hue_deg)
            told = replace(params, mode=of_case.mode, marker=replace(params.marker, hue_deg=of_case.marker.hue_deg))
            scores.append(scored(case, film, frames, told))
        return scores

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return the constants that matter: a difference above 1 point of right or false claims, or 3 of coverage."""
        rows = []
        for name, by_factor in numbers["constants"].items():
            if any(matters(of) for of in by_factor.values()):
                cells = (_cell(of, word) for word in JUDGED for of in by_factor.values())
                rows.append([f"`{name}`", *cells])
        header = ["constant", *(f"{word}, × {factor:g}" for word in JUDGED for factor in FACTORS)]
        return {"": Table(header, rows)}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Differences of all constants, sorted: most do not matter."""
        figure = Figure((9, 3), layout="constrained")
        axes = figure.subplots(1, len(JUDGED))
        for axis, word in zip(axes, JUDGED, strict=True):
            for factor in FACTORS:
                values = [of[str(factor)] for of in numbers["constants"].values()]
                axis.plot(sorted(of[word] for of in values if of and of[word] is not None), label=f"× {factor:g}")
            axis.set_title(word, fontsize=9)
            axis.set_xlabel("constants, sorted")
            axis.axhline(0, color="0.25", lw=0.8)
            axis.grid(alpha=0.25)
        axes[0].set_ylabel("difference (percentage points)")
        axes[0].legend(fontsize=8)
        return figure


def matters(difference: dict[str, float] | None) -> bool:
    """Whether a change of a constant shows; a value that the tracker refuses does not count."""
    if not difference:
        return False
    limits = {"right": 1.0, "false claims": 1.0, "95 % ellipsoid": 3.0}
    return any(abs(difference[word] or 0.0) > limit for word, limit in limits.items())


def _cell(difference: dict[str, float] | None, word: str) -> str:
    if not difference:
        return "refused"
    return "–" if difference[word] is None else f"{difference[word]:+.1f}"


def differences(scores: Scores | None, default: Scores) -> dict[str, float] | None:
    """Mean differences in percentage points over the films in which both have a value."""
    if scores is None:
        return None
    found = {}
    for word, key in JUDGED.items():
        pairs = [(new[key], old[key]) for new, old in zip(scores, default, strict=True)]
        known = [new - old for new, old in pairs if np.isfinite([new, old]).all()]
        found[word] = float(np.mean(known)) if known else np.nan
    return found


def modules() -> list[ModuleType]:
    """The modules of `tracking` that track in 3D."""
    names = [f"tracking.{found.name}" for found in pkgutil.iter_modules(tracking.__path__)]
    return [import_module(name) for name in names if name not in _OTHER_METHODS]


def module_constants() -> dict[str, Any]:
    """Numbers by "module.NAME" that are no part of a compiled function, in the module that defines them."""
    found: dict[str, Any] = {}
    for module in modules():
        tree = ast.parse(Path(str(module.__file__)).read_text())
        compiled = {name for function in tree.body if _is_compiled(function) for name in _names(function)}
        for node in tree.body:
            targets = [node.target] if isinstance(node, ast.AnnAssign) else getattr(node, "targets", [])
            for name in sorted(set().union(*map(_names, targets)) - compiled):
                value = vars(module).get(name) if name.isupper() else None
                if _is_number(value) or (isinstance(value, tuple) and value and all(map(_is_number, value))):
                    found[f"{module.__name__.removeprefix('tracking.')}.{name}"] = value
    return {name: value for name, value in found.items() if name not in _LAYOUT}


def _is_compiled(node: ast.AST) -> bool:
    return isinstance(node, ast.FunctionDef) and any("njit" in _names(decorator) for decorator in node.decorator_list)


def _names(node: ast.AST) -> set[str]:
    return {child.id for child in ast.walk(node) if isinstance(child, ast.Name)}


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value) and value != 0


def times(value: Any, factor: float) -> Any:
    """A number, or each of a tuple, times a factor; a whole number changes by at least 1."""
    if isinstance(value, tuple):
        return tuple(times(one, factor) for one in value)
    if isinstance(value, int):
        return max(round(value * factor), value + 1) if factor > 1 else max(min(round(value * factor), value - 1), 0)
    return value * factor


@contextmanager
def scaled(name: str, factor: float) -> Iterator[None]:
    """Within the context, a module's constant times a factor, also where other modules of `tracking` import it."""
    defined, _, constant = name.rpartition(".")
    value = vars(import_module(f"tracking.{defined}"))[constant]
    users = [module for module in modules() if vars(module).get(constant) is value]
    try:
        for module in users:
            setattr(module, constant, times(value, factor))
        yield
    finally:
        for module in users:
            setattr(module, constant, value)


def parameters(params: Any, before: str = "") -> dict[str, Any]:
    """Numbers of a dataclass of parameters, and of those it holds, by their dotted names; no colour to look for."""
    found: dict[str, Any] = {}
    for field in fields(params):
        value, name = getattr(params, field.name), f"{before}{field.name}"
        if is_dataclass(value):
            found |= parameters(value, f"{name}.")
        elif _is_number(value) and field.name not in ("hue_deg", "order"):
            found[name] = value
    return found


def with_parameter(params: Any, name: str, factor: float) -> Any:
    """The parameters with the one of that dotted name times a factor."""
    first, _, rest = name.partition(".")
    value = getattr(params, first)
    return replace(params, **{first: with_parameter(value, rest, factor) if rest else times(value, factor)})

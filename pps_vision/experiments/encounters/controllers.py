"""Every controller on the same encounters, ours with rendering too, and the random search for their parameters."""

import hashlib
import operator
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import ceil
from pathlib import Path
from tempfile import gettempdir
from typing import Any, get_args

import numpy as np
from tqdm import tqdm

from pps_vision.app.encounters import registry
from pps_vision.app.encounters.benchmark import Rates
from pps_vision.app.encounters.encounter import HARMLESS, HAZARDS, Condition, EncounterScene, draw
from pps_vision.app.encounters.kinematic import simulate_encounter
from pps_vision.app.encounters.registry import (
    CONTROLLERS,
    GEOMETRY,
    NONE,
    ONE,
    ONE_GATED,
    OURS,
    TRUE,
    Controller,
    ControllerParams,
    Entry,
    ours,
)
from pps_vision.app.encounters.suite import Rows, tasks_of, track_rng, train
from pps_vision.app.encounters.tracks import track_of
from pps_vision.app.encounters.training import MemoryName, learn
from pps_vision.app.intervals import percent_of
from pps_vision.app.simulation import Side
from pps_vision.experiments.baselines.arm_controllers import depth_space, potential_field
from pps_vision.experiments.encounters.reaching import REACHING, rows_of, train_maps
from pps_vision.experiments.encounters.rendered import render_encounter
from pps_vision.experiments.encounters.unfinished import run_tasks
from pps_vision.experiments.study import NOISE_SIGMA, interval, quartiles
from pps_vision.experiments.tables import Table, estimate, judged

SLOW_M_S = 0.15  # largest speed of the objects that approached R's robot
MIN_SELF_DISTANCE_MM = 20.0  # self-collision distance that no encounter may come below
_HARMLESS = 0.6  # encounters of each harmless condition for one of each approaching condition
_LOGARITHMIC = "gain"  # parameter drawn logarithmically
_SHARES: dict[Condition, float] = {
    **dict.fromkeys(HAZARDS, 1.0),
    **dict.fromkeys(HARMLESS, 0.06),
    "stop": 0.2,
    "graze": 0.2,
    "reach": 0.1,
}
Ranges = Mapping[str, tuple[float, float]]
_OF_ACTIVATION = {"threshold": (0.2, 0.7), "confirmation_s": (0.0, 0.2), "persist_s": (0.0, 0.6)}
_HOME_PER_S = (0.3, 3.0)
Tunable = tuple[Callable[..., Controller], MemoryName, Ranges]
"""A controller (scene, numbers), the memory whose activations it is given, and ranges of its parameters: uniform, the
logarithm of `gain`."""
BASELINES: dict[str, Tunable] = {
    "R eq. 6": (registry.paper, "of_both", _OF_ACTIVATION),
    "distance only": (registry.paper, "of_distance", _OF_ACTIVATION),
    "potential field": (
        potential_field,
        "probability",
        {"range_m": (0.05, 0.3), "gain": (1e-4, 1e-1), "home_per_s": _HOME_PER_S},
    ),
    "depth space": (depth_space, "probability", {"range_m": (0.05, 0.3), "aside": (0.0, 1.0)}),
    "taxel constraints": (
        registry.taxel_constraints,
        "of_both",
        {"threshold": (0.2, 0.7), "gain": (0.5, 20.0), "home_per_s": _HOME_PER_S},
    ),
}
_OURS_RANGES = {
    "threshold": (0.2, 0.7),
    "confirmation_s": (0.0, 0.3),
    "escape_clearance_m": (0.0, 0.1),
    "persist_s": (0.0, 0.6),
}
_TUNABLE: dict[str, Tunable] = {
    **BASELINES,
    GEOMETRY: (registry.geometry_only, CONTROLLERS[GEOMETRY].memory, {"margin_m": (0.0, 0.1)}),
    OURS: (ours, CONTROLLERS[OURS].memory, _OURS_RANGES),
}
"""Controllers of the random search; ours is measured with its defaults."""
TUNED: dict[str, ControllerParams] = {
    **registry.TUNED,
    "distance only": {"threshold": 0.4319, "confirmation_s": 0.1949, "persist_s": 0.5954},
    "potential field": {"range_m": 0.06314, "gain": 0.009452, "home_per_s": 1.112},
    "depth space": {"range_m": 0.08746, "aside": 0.2517},
}
"""Parameters of the baselines: the best of the part `tuning`."""
COMPARED = {
    **{name: CONTROLLERS[name] for name in (OURS, ONE, ONE_GATED, GEOMETRY)},
    **{name: Entry(partial(new, numbers=TUNED[name]), memory) for name, (new, memory, _) in BASELINES.items()},
    TRUE: CONTROLLERS[OURS],
    NONE: CONTROLLERS[NONE],
}
"""All controllers of the study."""
_COLUMNS = {
    "stop, ≤ 15 cm/s": "stop, slow",
    "press, through": "press and through",
    "harmless: no command (%)": "still, all",
}
_IS_MET: dict[str, Callable[[float, float], bool]] = {"≥ ": operator.ge, "> ": operator.gt, "": operator.eq}


def counts(n: int) -> dict[Condition, int]:
    """Return the number of encounters of each condition but `reach` in a tuning or rendered run."""
    return dict.fromkeys(HAZARDS, n) | dict.fromkeys(HARMLESS, ceil(_HARMLESS * n))


def rate(rows: Rows, key: str) -> list[float]:
    """Return the percentage of rows whose `key` is true, with Wilson's 95 % interval; NaN of none."""
    return percent_of(sum(bool(row[key]) for row in rows), len(rows))


def unfinished_folder(study: Any, part: str) -> Path:
    """Return the temporary folder of a part's finished encounters, by the study's parameters and all code."""
    parameters = {name: value for name, value in vars(study).items() if name not in ("parts", "workers")}
    root = Path(__file__).parents[3]
    packages = ("pps_vision", "rendering", "tracking", "learning", "control")
    files = [file for package in packages for file in sorted((root / package).rglob("*")) if file.is_file()]
    code = b"".join(file.read_bytes() for file in files if "__pycache__" not in file.parts)
    digest = hashlib.sha256(f"{part} {parameters}".encode() + code)
    return Path(gettempdir()) / f"pps-vision-{digest.hexdigest()[:16]}"


def run(study: Any) -> dict[str, Any]:
    """Return rates by controller, and paired differences from ours."""
    numbers = {condition: ceil(share * study.n) for condition, share in _SHARES.items()}
    folder = unfinished_folder(study, "controllers")
    train(folder, study.seed, study.share)
    train_maps(folder, study.seed, study.share)
    rows = run_tasks(folder, rows_of, tasks_of(numbers, study.seed, COMPARED), study.workers)
    return summary(rows, tuple(COMPARED))


def summary(rows: Rows, names: Sequence[str]) -> dict[str, Any]:
    """Return the numbers of the tables from a row for each encounter and controller."""
    rows = [row | {"untouched": not row["touched"], "still": not row["commands"]} for row in rows]
    by_name = {name: [row for row in rows if row["controller"] == name] for name in names}
    faults = [row for row in rows if row["faults"] or not row["self_distance_m"] * 1000 >= MIN_SELF_DISTANCE_MM]
    return {
        "encounters": {c: len(_of_condition(by_name[OURS], c)) for c in (*HAZARDS, *HARMLESS)},
        "controllers": {name: _of_controller(by_name[name], by_name[OURS]) for name in names},
        "reaching": {name: _of_reaching(by_name[name]) for name in REACHING if name in by_name},
        "limits": {
            "smallest_self_distance_mm": 1000 * min(row["self_distance_m"] for row in rows),
            "left": len(faults),
        },
    }


def _of_controller(rows: Rows, ours: Rows) -> dict[str, Any]:
    slow_stop = [row for row in _of_condition(rows, "stop") if row["speed_m_s"] <= SLOW_M_S]
    rates = Rates.of(rows)
    return {
        "press and through": rates.hard,
        "press and through, ours above": _ours_above(_of_condition(rows, "press", "through"), ours),
        "still, all": rates.harmless,
        "still": {c: rate(_of_condition(rows, c), "still") for c in HARMLESS},
        "stop, slow": rate(slow_stop, "untouched"),
        "stop, slow, distance_mm": quartiles([1000 * row["distance_m"] for row in slow_stop]),
        "stop, slow, lead_s": quartiles([row["lead_s"] for row in slow_stop if row["lead_s"] is not None]),
    }


def _of_reaching(rows: Rows) -> dict[str, Any]:
    """Rates of the objects to reach for that the part aimed at can touch, and of the others."""
    reaches = _of_condition(rows, "reach")
    touched = [row["touched_part"] == row["part"] for row in reaches if row["reachable"]]
    attempted = [row["commands"] > 0 for row in reaches if not row["reachable"]]
    return {
        "reachable: by the part aimed at": percent_of(sum(touched), len(touched)),
        "out of reach: attempted": percent_of(sum(attempted), len(attempted)),
    }


def _ours_above(rows: Rows, ours: Rows) -> list[float]:
    """Points by which ours leaves more of the same encounters untouched, with the interval of the paired difference."""
    touched = {(row["condition"], row["number"]): row["touched"] for row in ours}
    return interval([[100.0 * (row["touched"] - touched[row["condition"], row["number"]])] for row in rows])


def _of_condition(rows: Rows, *conditions: Condition) -> Rows:
    return [row for row in rows if row["condition"] in conditions]


def tables(numbers: dict[str, Any]) -> dict[str, Table]:
    rows = [
        [name, *(estimate(cell[key]) for key in _COLUMNS.values())] for name, cell in numbers["controllers"].items()
    ]
    return {
        "": Table(["not touched (%)", *_COLUMNS], rows),
        "goals": Table(["ours", "goal", "measured"], _goals(numbers)),
    }


def _goals(numbers: dict[str, Any]) -> list[list[str]]:
    """Goals of ours and the measured values; the value, not its interval, meets a goal."""
    cells = numbers["controllers"]
    ours = cells[OURS]
    above = {name: cells[name]["press and through, ours above"] for name in (*BASELINES, TRUE)}
    best = min(BASELINES, key=lambda name: above[name][0])
    limits = numbers["limits"]
    reaching = numbers["reaching"]
    goals: list[tuple[str, str, float, Sequence[float]]] = [
        ("stop, ≤ 15 cm/s: not touched (%)", "≥ ", 99, ours["stop, slow"]),
        ("distance left (mm), median", "≥ ", 20, ours["stop, slow, distance_mm"]),
        ("lead (s), median", "≥ ", 0.4, ours["stop, slow, lead_s"]),
        ("press, through: points above true positions", "≥ ", -3, above[TRUE]),
        ("points above distance only", "≥ ", 15, above["distance only"]),
        (f"points above the best baseline ({best})", "> ", 0, above[best]),
        ("harmless: no command (%)", "≥ ", 99, ours["still, all"]),
        ("reached by the part aimed at (%)", "≥ ", 98, reaching[OURS]["reachable: by the part aimed at"]),
        ("out of reach, attempted (%)", "", 0, reaching[OURS]["out of reach: attempted"]),
        ("smallest self-collision distance (mm)", "≥ ", MIN_SELF_DISTANCE_MM, [limits["smallest_self_distance_mm"]]),
        ("encounters that left a limit", "", 0, [limits["left"]]),
    ]
    return [
        [name, f"{sign}{bound:g}".replace("-", "−"), judged(estimate(value), not _IS_MET[sign](value[0], bound))]
        for name, sign, bound, value in goals
    ]


def tune(study: Any) -> dict[str, Any]:
    """Return the score of our defaults, and each controller's best draw."""
    params = {
        f"{name}#{k}": draw_params(ranges, np.random.default_rng((study.tuning_seed, j, k)))
        for j, (name, (_, _, ranges)) in enumerate(_TUNABLE.items())
        for k in range(study.draws)
    }
    entries = {OURS: CONTROLLERS[OURS]}
    for name, numbers in params.items():
        new, memory, _ = _TUNABLE[name.partition("#")[0]]
        entries[name] = Entry(partial(new, numbers=numbers), memory)
    folder = unfinished_folder(study, "tuning")
    train(folder, study.tuning_seed, study.share)
    rows = run_tasks(folder, rows_of, tasks_of(counts(study.n_tuning), study.tuning_seed, entries), study.workers)
    scores = {name: score([row for row in rows if row["controller"] == name]) for name in entries}
    best = {name: min((k for k in params if k.startswith(f"{name}#")), key=lambda k: scores[k]) for name in _TUNABLE}
    return {"ours": scores[OURS], "best": {name: {"score": scores[k], **params[k]} for name, k in best.items()}}


def draw_params(ranges: Mapping[str, tuple[float, float]], rng: np.random.Generator) -> ControllerParams:
    """Draw a baseline's parameters from their ranges, with four digits."""
    params = {}
    for name, (low, high) in ranges.items():
        value = np.exp(rng.uniform(np.log(low), np.log(high))) if name == _LOGARITHMIC else rng.uniform(low, high)
        params[name] = float(f"{value:.4g}")
    return params


def score(rows: Rows) -> float:
    """Return the percentage of approaching objects that touch plus that of harmless ones with a command."""
    return rate(_of_condition(rows, *HAZARDS), "touched")[0] + rate(_of_condition(rows, *HARMLESS), "commands")[0]


def run_rendered(study: Any) -> dict[str, Any]:
    """Return rates of the same encounters with and without rendering, and their paired difference."""
    scene = EncounterScene()
    memories = {side: learn(scene, side, study.seed, study.share) for side in get_args(Side)}
    numbers = [(condition, k) for condition, n in counts(study.n_rendered).items() for k in range(n)]
    rows: Rows = []
    for condition, number in tqdm(numbers, desc="rendered encounters", disable=None):
        encounter = draw(scene, condition, number, study.seed)
        tracks = track_of(scene, encounter, track_rng(study.seed, condition, number))
        quantity = "commands" if condition in HARMLESS else "touched"
        row: dict[str, Any] = {"condition": condition}
        for name, mode in ((OURS, "rendered"), (ONE, "constant")):
            memory = CONTROLLERS[name].memory_of(memories[encounter.side])
            result = render_encounter(scene, memory, encounter, NOISE_SIGMA, study.seed + number)
            row[mode] = not getattr(result, quantity)
        memory = memories[encounter.side].probability
        result = simulate_encounter(scene, memory, encounter, OURS, ours, tracks)
        rows.append({**row, "without": not getattr(result, quantity)})
    groups = {
        "all approaching": _of_condition(rows, *HAZARDS),
        "harmless": _of_condition(rows, *HARMLESS),
    }
    rates = {
        name: {
            "n": len(group),
            **{mode: rate(group, mode) for mode in ("rendered", "without", "constant")},
            "difference": _paired(group, "without"),
            "above constant": _paired(group, "constant"),
        }
        for name, group in groups.items()
    }
    return {"rates": rates}


def _paired(rows: Rows, other: str) -> list[float]:
    """Points by which the rendered rows succeed more often, with the interval of the paired difference."""
    return interval([[100.0 * (row["rendered"] - row[other])] for row in rows])


def rendered_table(numbers: dict[str, Any]) -> Table:
    """Return the rates of all modes; a difference that misses its goal is bold."""
    header = ["not touched, harmless: no command (%)", "n", "rendered", "not rendered", "difference"]
    more = {"constant": f"{ONE}, rendered", "above constant": "ours above it"}
    more = {key: title for key, title in more.items() if key in next(iter(numbers["rates"].values()))}
    rows = []
    for name, cell in numbers["rates"].items():
        difference = judged(estimate(cell["difference"]), abs(cell["difference"][0]) > 10)
        rates = estimate(cell["rendered"]), estimate(cell["without"]), difference
        rows.append([name, str(cell["n"]), *rates, *(estimate(cell[key]) for key in more)])
    return Table([*header, *more.values()], rows)

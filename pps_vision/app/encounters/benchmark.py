"""PPS-Bench: every controller meets the same objects, on exact tracks, as our eyes track them, and with more noise."""

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple, get_args

import numpy as np
from matplotlib.figure import Figure

from pps_vision.app import versions
from pps_vision.app.encounters.encounter import HARMLESS, HAZARDS, Condition
from pps_vision.app.encounters.registry import GEOMETRY, ONE, ONE_GATED, OURS, controller
from pps_vision.app.encounters.suite import Rows, map_tasks, memories, rows_of_task, tasks_of, train
from pps_vision.app.encounters.tracks import NOISE, Perception
from pps_vision.app.intervals import percent_of
from pps_vision.app.report import page
from pps_vision.recordings.atomic_write import whole_folder, write_json

SHIPPED = (OURS, ONE, ONE_GATED, GEOMETRY, "R eq. 6", "taxel constraints")  # controllers that the command compares
_SHARES: dict[Condition, float] = {
    **dict.fromkeys(HARMLESS, 0.05),
    **dict.fromkeys(HAZARDS, 0.1),
    **dict.fromkeys(("press", "through"), 0.25),
}
"""Share of each condition among the encounters."""
_COLUMNS = ("press", "through", "press, through", "approaching", "harmless", "score")


class Rates(NamedTuple):
    """Results of a controller, each in % with its 95 % interval: value, low, high."""

    press: list[float]  # objects that did not touch
    through: list[float]
    hard: list[float]  # of press and through together
    hazards: list[float]  # of all that approach
    harmless: list[float]  # objects for which the arm was never commanded to move
    score: list[float]  # mean of `hazards` and `harmless`

    @classmethod
    def of(cls, rows: Rows) -> "Rates":
        """Return the rates of a controller's encounters; the interval of the score is that of a sum of independent
        proportions (Newcombe 1998)."""

        def rate(*conditions: Condition) -> list[float]:
            of = [row for row in rows if row["condition"] in conditions]
            good = [not (row["commands"] if row["condition"] in HARMLESS else row["touched"]) for row in of]
            return percent_of(sum(good), len(good))

        hazards, harmless = np.array([rate(*HAZARDS), rate(*HARMLESS)])
        value = 0.5 * (hazards[0] + harmless[0])
        below, above = 0.5 * np.hypot(hazards[1:] - hazards[0], harmless[1:] - harmless[0])
        score = [float(value), float(value - below), float(value + above)]
        return cls(rate("press"), rate("through"), rate("press", "through"), hazards.tolist(), harmless.tolist(), score)


def benchmark(
    out: Path, n: int, seed: int, controllers: Sequence[str], workers: int, share: float = 1.0
) -> dict[Perception, dict[str, Rates]]:
    """Run n encounters, at least one of each kind, with each controller and perception; write encounters.json, a row of
    each, and report.html.

    `controllers`: names in the registry, or "MODULE:FUNCTION"; `share`: of R's numbers of training approaches.
    """
    counts = {condition: max(round(part * n), 1) for condition, part in _SHARES.items()}
    entries = {name: controller(name) for name in controllers}
    tasks = tasks_of(counts, seed, entries, get_args(Perception))
    with whole_folder(out) as folder, TemporaryDirectory() as learned:
        train(Path(learned), seed, share)
        rows = map_tasks(partial(rows_of_task, folder=Path(learned)), workers, list(tasks.values()))
        memories.cache_clear()
        rates: dict[Perception, dict[str, Rates]] = {perception: {} for perception in get_args(Perception)}
        for perception, name in product(rates, entries):
            of = [row for row in rows if row["perception"] == perception and row["controller"] == name]
            rates[perception][name] = Rates.of(of)
        settings = {"versions": versions.versions(), "seed": seed, "n": n}
        write_json(folder / "encounters.json", {**settings, "encounters": rows})
        lead = (
            f"{sum(counts.values())} encounters, seed {seed}. Per cent, with 95 % intervals: approaching objects that "
            "do not touch, harmless ones for which the arm is not commanded to move, and their mean, the score."
        )
        page.write_page(folder, "Controllers by score", lead, page.image(_chart(rates)), _sections(rates))
    return rates


def _sections(rates: Mapping[Perception, Mapping[str, Rates]]) -> list[page.Section]:
    texts = {
        "truth": "Exact positions and velocities.",
        "track": "The errors of our tracker, through its Kalman filter.",
        "noisy track": f"{NOISE:g} times these errors.",
    }
    sections: list[page.Section] = []
    for perception, by_name in rates.items():
        ranked = sorted(by_name.items(), key=lambda item: -item[1].score[0])
        rows = [[name, *("{:.1f} ({:.1f}–{:.1f})".format(*cell) for cell in cells)] for name, cells in ranked]
        table = page.table(["", *_COLUMNS], rows)
        sections.append((perception.capitalize(), texts[perception], table))
    return sections


def _chart(rates: Mapping[Perception, Mapping[str, Rates]]) -> Figure:
    """Draw the score of every controller, with its interval."""
    figure = Figure(figsize=(8, 4), layout="constrained")
    axis = figure.subplots()
    names = list(next(iter(rates.values())))
    for k, (perception, by_name) in enumerate(rates.items()):
        value, low, high = np.array([by_name[name].score for name in names]).T
        at = np.arange(len(names)) + 0.2 * (k - 1)
        axis.errorbar(at, value, np.maximum([value - low, high - value], 0), fmt="o", capsize=2, label=perception)
    axis.set_xticks(range(len(names)), names, rotation=20, ha="right")
    axis.set_ylabel("score (%)")
    axis.grid(alpha=0.25)
    axis.legend()
    return figure

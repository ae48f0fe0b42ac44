"""R's five sessions (Table 5): maps (Figs 4, 5, 7, 9), offsets of taxels (Fig 8) and their positions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import spearmanr

from learning.pps.joint_offsets import TouchTrial
from learning.pps.memory import Counts, MemoryParams, count_samples
from pps_vision.app.encounters.encounter import TRIALS, SessionName
from pps_vision.app.encounters.robots import ErrorSources, MiscalibratedRobot, true_robot
from pps_vision.app.report.figures import landscape
from pps_vision.experiments.baselines.single_taxel import empty_map
from pps_vision.experiments.charts import bar_chart
from pps_vision.experiments.pps import positions
from pps_vision.experiments.pps.erring import observe
from pps_vision.experiments.pps.ridges import FINE, landscape_chart, offsets, ridge_width
from pps_vision.experiments.pps.session_trials import SessionStudy, exact_trials
from pps_vision.experiments.pps.taxel_trials import Session, Trial, perceive, train_memory
from pps_vision.experiments.study import Part, interval, mean, percent
from pps_vision.experiments.tables import Table, estimate
from pps_vision.geometry.se3 import move_points
from pps_vision.types import Array

_COLUMNS = ("minutes", "trials", "samples", "samples_of_shown_taxel")
PAPER: dict[SessionName, tuple[int, int, int, int]] = {
    "motor": (31, 82, 3512, 1625),
    "visual": (30, 45, 1166, 376),
    "inner": (23, 53, 1886, 627),
    "outer": (17, 34, 1348, 451),
    "palm": (44, 77, 2833, 944),
}
"""R Table 5."""
TITLES: dict[SessionName, str] = {
    "motor": "double touch, felt (Fig 4)",
    "visual": "double touch, seen (Fig 5)",
    "inner": "objects, inner forearm (Fig 7)",
    "outer": "objects, outer forearm (Fig 7)",
    "palm": "objects, palm (Fig 7)",
}
FIG9_TRIALS = (1, 4, 53)
_RESAMPLINGS = 200  # bootstrap samples of the trials

PAPER_OFFSETS_MM: dict[SessionName, float] = {"inner": 21.1, "outer": 17.3, "palm": 11.6}  # R Fig 8
MIN_TOUCHES = 5
LAST_MOMENTS = MemoryParams(distance_range_m=(-0.15, 0.20), ttc_range_s=(-0.025, 0.225), bins=(140, 5))
"""The last 0.2 s, before which hands slow down; samples come every 50 ms, in the middle of a TTC bin."""


def landscapes(study: "PpsSessions") -> dict[str, Any]:
    """Return each session's numbers, R Fig 9, and how activation depends on the distance from the wrist."""
    robots = [MiscalibratedRobot.draw(ErrorSources(), np.random.default_rng((study.seed, k))) for k in range(study.n)]
    sessions = {name: Session.of(name, study.measured_trials(name)) for name in TITLES}
    numbers = {name: _session_numbers(name, session, robots, study.seed) for name, session in sessions.items()}
    return {"sessions": numbers, "fig9": _fig9(sessions["inner"]), "wrist": _by_wrist(sessions["inner"])}


def _session_numbers(
    name: SessionName, session: Session, robots: list[MiscalibratedRobot], seed: int
) -> dict[str, Any]:
    """Table 5, the shown taxel's map, and the ridge's width with 95 % over trials, and over miscalibrated robots.

    A sample is a step of 50 ms in which a taxel of the part perceives the object. Minutes count the movements only;
    R's include the way back and pauses.
    """
    memory = train_memory(session.trials)
    shown = session.shown_taxel(memory)
    counts = np.array([_pooled_counts(session, [trial]) for trial in session.trials])
    n = len(counts)
    resampled = np.random.default_rng(seed).multinomial(n, np.full(n, 1 / n), _RESAMPLINGS)
    widths = [100 * ridge_width(np.tensordot(times, counts, 1)) for times in resampled]
    erring_widths = []
    for robot in robots:
        rng = np.random.default_rng(seed)
        trials = [observe(robot, trial, name != "motor", rng) for trial in exact_trials(name, n, seed)]
        observed = Session.of(name, trials, robot.model, robot.skin)
        erring_widths.append([100 * ridge_width(_pooled_counts(observed, observed.trials))])
    is_touched = np.any([trial.touched for trial in session.trials], axis=0)[list(session.aimed)]
    return {
        "minutes": round(sum(float(np.ptp(trial.stamps_s)) for trial in session.trials) / 60, 2),
        "trials": n,
        "samples": sum(int(np.isfinite(perceive(trial)[0]).any(axis=1).sum()) for trial in session.trials),
        "samples_of_shown_taxel": int(memory.counts[shown].sum()),
        "taxels_touched": f"{is_touched.sum()} of {len(is_touched)}",
        "taxel": session.name(shown),
        "activation": np.round(landscape(memory, shown), 3).tolist(),
        "ridge_width_cm": [100 * ridge_width(counts.sum(axis=0)), *map(float, np.percentile(widths, (2.5, 97.5)))],
        "ridge_width_erring_cm": interval(erring_widths),
    }


def _pooled_counts(session: Session, trials: Sequence[Trial]) -> Counts:
    """Fine counts (D bins, TTC bins, 2) of all taxels aimed at, after trials."""
    counts: Counts = train_memory(trials, FINE).counts[list(session.aimed)].sum(axis=0)
    return counts


def _fig9(session: Session) -> dict[str, Any]:
    """Maps of the two nearest taxels that the first trial touched, after each number of trials."""
    positions = session.part.positions_m
    touched = [i for i in session.aimed if session.trials[0].touched[i]]
    pairs = combinations(touched if len(touched) > 1 else session.aimed, 2)
    nearest = min(pairs, key=lambda pair: float(np.linalg.norm(positions[pair[0]] - positions[pair[1]])))
    memories = {f"{n} trial{'s'[: n > 1]}": train_memory(session.trials[:n]) for n in FIG9_TRIALS}
    return {
        f"{session.name(taxel)}, {after}": np.round(landscape(memory, taxel), 3).tolist()
        for taxel in nearest
        for after, memory in memories.items()
    }


def _by_wrist(session: Session) -> dict[str, float]:
    """Rank correlation of the mean activation of a taxel and its distance from the palm (wrist straight).

    R, of Fig 9: taxels near the wrist respond less, so that the correlation is above 0.
    """
    memory = train_memory(session.trials)
    robot, _, _ = true_robot()
    straight = robot.at(robot.clamp(np.zeros(robot.n_joints)))
    positions = move_points(straight.T_root(session.part.frame), session.part.positions_m)[list(session.aimed)]
    from_palm_m = np.linalg.norm(positions - straight.point(robot.names.palm("left")), axis=1)
    activation = [landscape(memory, taxel).mean() for taxel in session.aimed]
    return {"rank_correlation": round(float(spearmanr(from_palm_m, activation).statistic), 3)}


def draw_landscapes(numbers: dict[str, Any]) -> dict[str, Figure]:
    """Draw the maps of the sessions and of Fig 9."""
    maps = {
        f"{TITLES[name]}\n{session['taxel']}, {session['samples_of_shown_taxel']} samples": session["activation"]
        for name, session in numbers["sessions"].items()
    }
    return {"": landscape_chart(maps, 3), "fig9": landscape_chart(numbers["fig9"], len(FIG9_TRIALS))}


def tabulate_landscapes(numbers: dict[str, Any]) -> Table:
    """Return Table 5, ours / R's, the taxels touched, and the width of the ridge."""
    rows = []
    for name, session in numbers["sessions"].items():
        cells = [f"{session[key]:g} / {paper}" for key, paper in zip(_COLUMNS, PAPER[name], strict=True)]
        widths = [estimate(session[key]) for key in ("ridge_width_cm", "ridge_width_erring_cm")]
        rows.append([name, *cells, session["taxels_touched"], *widths])
    header = ["session (ours / R)", *(key.replace("_", " ") for key in _COLUMNS), "taxels touched"]
    return Table([*header, "ridge (cm; 95 % over trials)", "with R's errors (cm; 95 % over robots)"], rows)


def taxel_offsets(study: "PpsSessions") -> dict[str, Any]:
    """Return, by part, the mean offsets, and the error of the estimates; 95 % intervals over miscalibrated robots.

    TTC is the time left to the touch, known afterwards. TTC as perceived before (R eq. 2) cannot show an error along
    the approach, which shifts D and TTC equally.
    """
    robots = [{part: _robot_offsets(study, part, k) for part in PAPER_OFFSETS_MM} for k in range(study.n)]
    parts = {
        part: {
            "found_mm": interval([robot[part][0] for robot in robots]),
            "true_mm": mean(np.concatenate([robot[part][1] for robot in robots])),
            "paper_mm": paper_mm,
        }
        for part, paper_mm in PAPER_OFFSETS_MM.items()
    }
    errors = [np.concatenate([abs(estimated - true) for estimated, true in robot.values()]) for robot in robots]
    return {
        "parts": parts,
        "within_3_mm_percent": interval([robot <= 3 for robot in errors], percent),
    }


def _robot_offsets(study: "PpsSessions", part: SessionName, k: int) -> Array:
    """Estimated and true offsets in mm (2, n) of the taxels that robot k's session touches often enough."""
    rng = np.random.default_rng((study.seed, k))
    robot = MiscalibratedRobot.draw(ErrorSources(), rng)
    exact = exact_trials(part, study.size(TRIALS[part]), study.seed)
    session = Session.of(part, [observe(robot, _end(t), True, rng) for t in exact], robot.model, robot.skin)
    memory = empty_map(len(session.part.ids), LAST_MOMENTS)
    at_touch = []
    for trial in session.trials:
        D, _ = perceive(trial)
        left_s = np.broadcast_to((trial.stamps_s[-1] - trial.stamps_s)[:, None], D.shape)
        memory = count_samples(memory, D, left_s, trial.touched)
        at_touch.append(np.where(trial.touched, D[-1], np.nan))
    estimates = offsets(memory)
    enough = (np.isfinite(at_touch).sum(axis=0) >= MIN_TOUCHES) & np.isfinite(estimates)
    return 1000 * np.array([estimates[enough], np.nanmean(np.array(at_touch)[:, enough], axis=0)])


def _end(trial: TouchTrial) -> TouchTrial:
    """The last samples of a trial; no others count here."""
    last = trial.stamps_s >= trial.stamps_s[-1] - 2 * LAST_MOMENTS.ttc_range_s[1]
    samples = ("stamps_s", "joints_rad", "positions", "velocities", "velocity_covs", "radius_m")
    return replace(trial, **{name: getattr(trial, name)[last] for name in samples})


def draw_offsets(numbers: dict[str, Any]) -> Figure:
    """Draw the mean offset of each part: estimated, true, and R's on the robot."""
    parts = numbers["parts"]
    labels = {"found_mm": "estimated (95 % over robots)", "true_mm": "true", "paper_mm": "R, on the robot"}
    series = {label: [part[key] for part in parts.values()] for key, label in labels.items()}
    return bar_chart(list(parts), series, "mean offset to the object's centre (mm)", 5.6)


@dataclass(frozen=True)
class PpsSessions(SessionStudy):
    """Landscapes: the map of the taxel with the most samples after each of R's sessions.

    The ridge's width is the standard deviation of the positive samples' D about their line in (D, TTC), over all taxels
    aimed at. Offsets: the taxels' offsets read from their maps, against the true ones. Positions: of taxels 3 cm off at
    first, after double touches.
    """

    MINUTES: ClassVar[int] = 11
    SHORT: ClassVar[Mapping[str, Any]] = {"share": 0.05}
    PARTS: ClassVar[Mapping[str, Part]] = {
        "landscapes": Part(landscapes, draw_landscapes, tabulate_landscapes),
        "offsets": Part(taxel_offsets, draw_offsets),
        "positions": Part(positions.run, table=positions.table),
    }

    n: int = 5  # miscalibrated robots, and skins whose taxels are 3 cm off

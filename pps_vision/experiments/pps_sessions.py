"""R's five sessions (Table 5): maps (Figs 4, 5, 7, 9), double touches, misaimed touches, offsets of taxels (Fig 8)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, cycle, islice
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import spearmanr
from tqdm import tqdm

from control.double_touch import FINGERTIP_RADIUS_M, DoubleTouch, DoubleTouching, DoubleTouchParams
from learning.pps.joint_offsets import TouchTrial
from learning.pps.memory import Counts, MemoryParams, PPSMemory, count_samples
from pps_vision.app.encounters.postures import TRIALS, SessionName
from pps_vision.app.report.figures import landscape
from pps_vision.experiments.baselines.single_taxel import empty_map
from pps_vision.experiments.charts import bars, panels
from pps_vision.experiments.pps.movements import finger_movement, plans, true_robot
from pps_vision.experiments.pps.ridges import FINE, landscape_chart, offsets, ridge_width
from pps_vision.experiments.pps.robot_errors import ErrorSources, MiscalibratedRobot
from pps_vision.experiments.pps.session_trials import SessionStudy, exact_trials
from pps_vision.experiments.pps.taxel_trials import FOREARM, Session, Trial, perceive, train_memory
from pps_vision.experiments.study import Part, interval, mean, median, percent
from pps_vision.experiments.tables import Table, estimate
from pps_vision.geometry.se3 import move_points
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import INNER_FOREARM, OUTER_FOREARM, TOUCH_RADIUS_M, Skin, icub_skin
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

R_SPEEDS_M_S = (0.05, 0.15)  # range of the speed of R's simulated approaches, the only speeds that R states
_ATTEMPTS = 10  # at each misaimed touch
_MIN_STEPS = 3  # shortest movement; its velocity is a difference quotient

PAPER_OFFSETS_MM: dict[SessionName, float] = {"inner": 21.1, "outer": 17.3, "palm": 11.6}  # R Fig 8
OFFSET_METHODS = {
    "positive": "positive samples, time left",
    "frequency": "weights f (R)",
    "perceived_ttc": "TTC as perceived",
}
MIN_TOUCHES = 5
LAST_MOMENTS = MemoryParams(distance_range_m=(-0.15, 0.20), ttc_range_s=(-0.025, 0.225), bins=(140, 5))
"""The last 0.2 s, before which hands slow down; samples come every 50 ms, in the middle of a TTC bin."""


def table5(session: Session) -> dict[str, float]:
    """Return the columns of R Table 5.

    A sample is a step of 50 ms in which a taxel of the part perceives the object. Minutes count the movements only;
    R's include the way back and pauses.
    """
    memory = train_memory(session.trials)
    return {
        "minutes": round(sum(float(np.ptp(trial.stamps_s)) for trial in session.trials) / 60, 2),
        "trials": len(session.trials),
        "samples": sum(int(np.isfinite(perceive(trial)[0]).any(axis=1).sum()) for trial in session.trials),
        "samples_of_shown_taxel": int(memory.counts[session.shown_taxel(memory)].sum()),
    }


def taxels_touched(session: Session) -> int:
    """Return how many of the taxels aimed at were ever touched."""
    touched = np.any([trial.touched for trial in session.trials], axis=0)
    return int(touched[list(session.aimed)].sum())


def landscapes(study: "PpsSessions") -> dict[str, Any]:
    """Return each session's numbers, R Fig 9, and how activation depends on the distance from the wrist."""
    robots = [MiscalibratedRobot.draw(ErrorSources(), np.random.default_rng((study.seed, k))) for k in range(study.n)]
    sessions = {name: Session.of(name, study.measured_trials(name)) for name in TITLES}
    numbers = {name: _session_numbers(name, session, robots, study.seed) for name, session in sessions.items()}
    return {"sessions": numbers, "fig9": _fig9(sessions["inner"]), "wrist": _by_wrist(sessions["inner"])}


def _session_numbers(
    name: SessionName, session: Session, robots: list[MiscalibratedRobot], seed: int
) -> dict[str, Any]:
    """Table 5, the shown taxel's map, and the ridge's width with 95 % over trials, and over miscalibrated robots."""
    memory = train_memory(session.trials)
    shown = session.shown_taxel(memory)
    counts = np.array([_pooled_counts(session, [trial]) for trial in session.trials])
    n = len(counts)
    resampled = np.random.default_rng(seed).multinomial(n, np.full(n, 1 / n), _RESAMPLINGS)
    widths = [100 * ridge_width(np.tensordot(times, counts, 1)) for times in resampled]
    miscalibrated = []
    for robot in robots:
        rng = np.random.default_rng(seed)
        trials = [robot.observe(trial, name != "motor", rng) for trial in exact_trials(name, n, seed)]
        observed = Session.of(name, trials, robot.model, robot.skin)
        miscalibrated.append([100 * ridge_width(_pooled_counts(observed, observed.trials))])
    return {
        **table5(session),
        "taxels_touched": f"{taxels_touched(session)} of {len(session.aimed)}",
        "taxel": session.name(shown),
        "activation": np.round(landscape(memory, shown), 3).tolist(),
        "ridge_width_cm": [100 * ridge_width(counts.sum(axis=0)), *map(float, np.percentile(widths, (2.5, 97.5)))],
        "ridge_width_erring_cm": interval(miscalibrated),
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
    return {
        f"{session.name(taxel)}, {n} trial{'s'[: n > 1]}": np.round(
            landscape(train_memory(session.trials[:n]), taxel), 3
        ).tolist()
        for taxel in nearest
        for n in FIG9_TRIALS
    }


def _by_wrist(session: Session) -> dict[str, float]:
    """Rank correlation of the mean activation of a taxel and its distance from the palm (wrist straight).

    R, of Fig 9: taxels near the wrist respond less, so that the correlation is above 0.
    """
    memory = train_memory(session.trials)
    robot, _, _ = true_robot()
    straight = robot.at(robot.clamp(np.zeros(robot.n_joints)))
    palm = straight.T_root(robot.names.palm("left"))[:3, 3]
    positions = move_points(straight.T_root(session.part.frame), session.part.positions_m)
    from_palm_m = np.linalg.norm(positions - palm, axis=1)[list(session.aimed)]
    activation = np.array([landscape(memory, taxel).mean() for taxel in session.aimed])
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


def double_touches(study: "PpsSessions") -> dict[str, Any]:
    """Return the percentage of random start postures that lead to each forearm taxel."""
    robot, _, _ = true_robot()
    planner = DoubleTouching(robot, icub_skin(("left_forearm",)).parts[0])

    def feasible_percent(taxel: int) -> float:
        planned = planner.plan(planner.part.ids.index(taxel), study.starts, np.random.default_rng((study.seed, taxel)))
        return 100 * sum(isinstance(plan, DoubleTouch) for plan in planned) / study.starts

    return {"feasible_percent": {taxel: feasible_percent(taxel) for taxel in INNER_FOREARM + OUTER_FOREARM}}


def misaimed(study: "PpsSessions") -> dict[str, Any]:
    """Return the samples and the number of taxels touched by every miscalibrated robot's felt double touches."""
    robots = []
    for k in tqdm(range(study.n), desc="robots", disable=None):
        robot = MiscalibratedRobot.draw(ErrorSources(), np.random.default_rng((study.seed, k)))
        trials = misaimed_touches(robot, study.size(TRIALS["motor"]), study.seed + k)
        session = Session.of("motor", trials, robot.model, robot.skin)
        robots.append({"samples": table5(session)["samples"], "touched": taxels_touched(session)})
    return {"robots": robots}


def misaimed_touches(robot: MiscalibratedRobot, n: int, seed: int) -> list[TouchTrial]:
    """Return `n` felt double touches that touch the left forearm anywhere (fewer if 10 n attempts do not suffice).

    The robot aims at the inner taxels one after another by its own model. The movement goes on until the true skin is
    touched, at most to its planned end 3 cm under the assumed skin.
    """
    icub, _, skin = true_robot()
    (assumed,) = (part for part in robot.skin.parts if part.name == FOREARM)
    params = DoubleTouchParams()
    end = replace(assumed, positions_m=assumed.positions_m - params.press_m * assumed.normals)
    params = replace(params, start_m=params.start_m + params.press_m, press_m=0.0, peak_m_s=R_SPEEDS_M_S)
    planner = DoubleTouching(robot.model, end, params)
    planned = {taxel: plans(planner, taxel, (seed,)) for taxel in INNER_FOREARM}
    rng = np.random.default_rng(seed)
    trials: list[TouchTrial] = []
    for taxel in islice(cycle(INNER_FOREARM), _ATTEMPTS * n):
        slack = robot.slack_rad * rng.standard_normal(robot.model.n_joints)
        slack_robot = replace(robot, joint_offsets_rad=robot.joint_offsets_rad + slack, slack_rad=0.0)
        plan = next(planned[taxel], None)  # None: by its own model the robot cannot get there
        touch = plan and _until_touch(icub, skin, plan, slack_robot.joint_offsets_rad)
        if touch is not None:
            trials.append(slack_robot.observe(finger_movement(icub, skin, touch).trial, False, rng))
        if len(trials) == n:
            break
    return trials


def _until_touch(icub: Robot, skin: Skin, plan: DoubleTouch, offsets_rad: Array) -> DoubleTouch | None:
    """The true movement while the encoders read `plan`, up to where the fingertip meets the skin; None without a touch.

    It meets the skin where it comes below the tangent plane of a taxel that it then touches.
    """
    joints = plan.joints_rad - offsets_rad
    (part,) = (part for part in skin.parts if part.name == FOREARM)
    for k, q in enumerate(joints):
        posture = icub.at(q)
        T = posture.T_root(part.frame)
        from_taxels = T[:3, :3].T @ (posture.point(icub.names.index_tips[1]) - T[:3, 3]) - part.positions_m
        below = (from_taxels * part.normals).sum(axis=1) <= FINGERTIP_RADIUS_M
        if (below & (np.linalg.norm(from_taxels, axis=1) <= FINGERTIP_RADIUS_M + TOUCH_RADIUS_M)).any():
            return DoubleTouch(plan.stamps_s[: k + 1], joints[: k + 1]) if k >= _MIN_STEPS else None
    return None


def taxel_offsets(study: "PpsSessions") -> dict[str, Any]:
    """Return, by part, the mean offsets, and by method the error; 95 % intervals over miscalibrated robots.

    TTC is the time left to the touch, known afterwards. TTC as perceived before (R eq. 2) cannot show an error along
    the approach, which shifts D and TTC equally.
    """
    robots = [[row for part in PAPER_OFFSETS_MM for row in _robot_offsets(study, part, k)] for k in range(study.n)]
    parts = {}
    for part, paper_mm in PAPER_OFFSETS_MM.items():
        rows = [[row for row in robot if row["part"] == part] for robot in robots]
        parts[part] = {
            "found_mm": interval([[row["positive"] for row in robot] for robot in rows]),
            "true_mm": mean(np.array([row["true"] for robot in rows for row in robot])),
            "paper_mm": paper_mm,
        }
    methods = {}
    for method in OFFSET_METHODS:
        errors = [np.array([abs(row[method] - row["true"]) for row in robot]) for robot in robots]
        methods[method] = {
            "error_median_mm": interval(errors, median),
            "within_3_mm_percent": interval([robot <= 3 for robot in errors], percent),
        }
    return {"taxels": sum(map(len, robots)), "parts": parts, "methods": methods}


def _robot_offsets(study: "PpsSessions", part: SessionName, k: int) -> list[dict[str, Any]]:
    """True and estimated offsets in mm of the taxels that robot k's session touches often enough."""
    rng = np.random.default_rng((study.seed, k))
    robot = MiscalibratedRobot.draw(ErrorSources(), rng)
    exact = exact_trials(part, study.size(TRIALS[part]), study.seed)
    session = Session.of(part, [robot.observe(_end(t), True, rng) for t in exact], robot.model, robot.skin)
    memory = count_by_time_left(session.trials)
    estimates = {
        "positive": offsets(memory),
        "frequency": offsets(memory, memory.frequency),
        "perceived_ttc": offsets(train_memory(session.trials)),
    }
    at_touch = np.array([np.where(trial.touched, perceive(trial)[0][-1], np.nan) for trial in session.trials])
    enough = (np.isfinite(at_touch).sum(axis=0) >= MIN_TOUCHES) & np.isfinite(estimates["positive"])
    return [
        {"part": part, "true": 1000 * float(np.nanmean(at_touch[:, i]))}
        | {method: 1000 * float(values[i]) for method, values in estimates.items()}
        for i in np.flatnonzero(enough)
    ]


def _end(trial: TouchTrial) -> TouchTrial:
    """The last samples of a trial; no others count here."""
    last = trial.stamps_s >= trial.stamps_s[-1] - 2 * LAST_MOMENTS.ttc_range_s[1]
    samples = ("stamps_s", "joints_rad", "positions", "velocities", "velocity_covs", "radius_m")
    return replace(trial, **{name: getattr(trial, name)[last] for name in samples})


def count_by_time_left(trials: Sequence[Trial]) -> PPSMemory:
    """Return the map of D and the time left to the touch."""
    memory = empty_map(len(trials[0].touched), LAST_MOMENTS)
    for trial in trials:
        D, _ = perceive(trial)
        left_s = np.broadcast_to((trial.stamps_s[-1] - trial.stamps_s)[:, None], D.shape)
        memory = count_samples(memory, D, left_s, trial.touched)
    return memory


def draw_offsets(numbers: dict[str, Any]) -> Figure:
    """Draw the mean offset of each part: estimated, true, and R's on the robot."""
    figure, (axis,) = panels(1, width=5.6)
    parts = numbers["parts"]
    labels = {"found_mm": "estimated (95 % over robots)", "true_mm": "true", "paper_mm": "R, on the robot"}
    series = {label: [part[key] for part in parts.values()] for key, label in labels.items()}
    bars(axis, list(parts), series, "mean offset to the object's centre (mm)")
    axis.legend(fontsize=8)
    return figure


def tabulate_offsets(numbers: dict[str, Any]) -> Table:
    """Return the error of each method."""
    rows = [
        [OFFSET_METHODS[method], estimate(errors["error_median_mm"]), estimate(errors["within_3_mm_percent"])]
        for method, errors in numbers["methods"].items()
    ]
    return Table([f"{numbers['taxels']} taxels", "median error (mm)", "within 3 mm (%)"], rows)


@dataclass(frozen=True)
class PpsSessions(SessionStudy):
    """Landscapes: the map of the taxel with the most samples after each of R's sessions.

    The ridge's width is the standard deviation of the positive samples' D about their line in (D, TTC), over all taxels
    aimed at.

    Double touches: feasible start postures by taxel. Misaimed: R's felt double touches by
    miscalibrated robots. Offsets: the taxels' offsets read from their maps, against the true ones.
    """

    SHORT: ClassVar[Mapping[str, Any]] = {"share": 0.05, "starts": 4}
    PARTS: ClassVar[Mapping[str, Part]] = {
        "landscapes": Part(landscapes, draw_landscapes, tabulate_landscapes),
        "double_touches": Part(double_touches),
        "misaimed": Part(misaimed),
        "offsets": Part(taxel_offsets, draw_offsets, tabulate_offsets),
    }

    n: int = 5  # miscalibrated robots
    starts: int = 24  # random start postures of the double touches of each taxel

"""R Figs 4, 5, 7 and 9: the map of one taxel after each of R's sessions, and after 1, 4 and 53 trials."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import spearmanr

from learning.pps.memory import Counts
from pps_vision.app.report.figures import landscape
from pps_vision.experiments.charts import bars, panels
from pps_vision.experiments.pps.maps import FINE, landscape_chart, ridge_width
from pps_vision.experiments.pps.movements import SessionName
from pps_vision.experiments.pps.perceived import Session, train_memory
from pps_vision.experiments.pps.robot_errors import ErringRobot, ErrorSources
from pps_vision.experiments.pps.trials import SessionStudy, exact_trials
from pps_vision.experiments.study import interval
from pps_vision.robot.icub import load_icub

TITLES: dict[SessionName, str] = {
    "motor": "double touch, felt (Fig 4)",
    "visual": "double touch, seen (Fig 5)",
    "inner": "objects, inner forearm (Fig 7)",
    "outer": "objects, outer forearm (Fig 7)",
    "palm": "objects, palm (Fig 7)",
}
AFTER = (1, 4, 53)  # trials (Fig 9)
_DRAWS = 200  # of the trials, for an interval


@dataclass(frozen=True)
class Landscapes(SessionStudy):
    """The map of the taxel with the most samples after each of R's sessions, and the width of its ridge.

    The ridge's width is the standard deviation of the positive samples' D about their line in (D, TTC), over all
    taxels aimed at. Robots that err as R's sources say take the same sessions with exactly known objects.
    """

    SHORT: ClassVar[Mapping[str, Any]] = {"share": 0.1}

    n: int = 8
    """Robots that err, each in its own way."""

    def run(self) -> dict[str, Any]:
        """Return, by session, the map and the ridge's width with 95 % over trials and over erring robots."""
        robots = [ErringRobot.draw(ErrorSources(), np.random.default_rng((self.seed, k))) for k in range(self.n)]
        sessions = {name: Session.of(name, self.seen(name)) for name in TITLES}
        found = {name: self._measure(name, session, robots) for name, session in sessions.items()}
        return {"sessions": found, "fig9": _fig9(sessions["inner"]), "wrist": _wrist(sessions["inner"])}

    def _measure(self, name: SessionName, session: Session, robots: list[ErringRobot]) -> dict[str, Any]:
        memory = train_memory(session.trials)
        shown = session.shown_taxel(memory)
        by_trial = [_pooled(session, train_memory([one], FINE).counts) for one in session.trials]
        return {
            "taxel": session.name(shown),
            "trials": len(session.trials),
            "samples": int(memory.counts[shown].sum()),
            "activation": np.round(landscape(memory, shown), 3).tolist(),
            "ridge_width_cm": _width_interval(by_trial, self.seed),
            "ridge_width_erring_cm": interval([[self._erring_width(name, len(by_trial), robot)] for robot in robots]),
        }

    def _erring_width(self, name: SessionName, n: int, robot: ErringRobot) -> float:
        rng = np.random.default_rng(self.seed)
        trials = [robot.observe(t, name != "motor", rng) for t in exact_trials(name, n, self.seed)]
        session = Session.of(name, trials, robot.model, robot.skin)
        return 100 * ridge_width(_pooled(session, train_memory(session.trials, FINE).counts))

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Draw the maps of the sessions, the widths of their ridges, and the maps of Fig 9."""
        of = numbers["sessions"]
        maps = {
            f"{TITLES[name]}\n{one['taxel']}, {one['samples']} samples": one["activation"] for name, one in of.items()
        }
        ridge, (axis,) = panels(1, width=6.0)
        keys = {
            "ridge_width_cm": "no errors (95 % over trials)",
            "ridge_width_erring_cm": "R's errors (95 % over robots)",
        }
        series = {label: [one[key] for one in of.values()] for key, label in keys.items()}
        bars(axis, list(of), series, "width of the ridge (cm)")
        axis.legend(fontsize=8)
        return {"": landscape_chart(maps, 3), "ridge": ridge, "fig9": landscape_chart(numbers["fig9"], len(AFTER))}


def _pooled(session: Session, counts: Counts) -> Counts:
    """Counts (D bins, TTC bins, 2) of all taxels aimed at together."""
    pooled: Counts = counts[list(session.aimed)].sum(axis=0)
    return pooled


def _width_interval(by_trial: list[Counts], seed: int) -> list[float]:
    """Ridge width in cm, [value, low, high], with 95 % by resampling trials."""
    counts = np.array(by_trial)
    rng = np.random.default_rng(seed)
    times = rng.multinomial(len(counts), np.full(len(counts), 1 / len(counts)), _DRAWS)
    widths = [100 * ridge_width(np.tensordot(of, counts, 1)) for of in times]
    low, high = np.percentile(widths, (2.5, 97.5))
    return [100 * ridge_width(counts.sum(axis=0)), float(low), float(high)]


def _fig9(session: Session) -> dict[str, Any]:
    """Maps of the two nearest taxels that the first trial touched both, after each number of trials."""
    positions = session.part.positions_m
    touched = [i for i in session.aimed if session.trials[0].touched[i]]
    pairs = combinations(touched if len(touched) > 1 else session.aimed, 2)
    pair = min(pairs, key=lambda ij: float(np.linalg.norm(positions[ij[0]] - positions[ij[1]])))
    return {
        f"{session.name(i)}, {n} trial{'s'[: n > 1]}": np.round(
            landscape(train_memory(session.trials[:n]), i), 3
        ).tolist()
        for i in pair
        for n in AFTER
    }


def _wrist(session: Session) -> dict[str, Any]:
    """Do taxels near the wrist respond less (R, of Fig 9)?  Mean activation over the map of every taxel aimed at, its
    distance from the palm with the wrist straight, and their rank correlation over the taxels (R: above 0)."""
    memory, robot = train_memory(session.trials), load_icub()
    straight = robot.at(robot.clamp(np.zeros(robot.n_joints)))
    palm = straight.T_root(robot.names.palm("left"))[:3, 3]
    T_root_part = straight.T_root(session.part.frame)
    positions = session.part.positions_m @ T_root_part[:3, :3].T + T_root_part[:3, 3]
    away_m = np.linalg.norm(positions - palm, axis=1)[list(session.aimed)]
    mean = np.array([landscape(memory, taxel).mean() for taxel in session.aimed])
    return {
        "taxels": [session.name(taxel) for taxel in session.aimed],
        "from_palm_cm": np.round(100 * away_m, 2).tolist(),
        "mean_activation": np.round(mean, 3).tolist(),
        "rank_correlation": round(float(spearmanr(away_m, mean).statistic), 3),
    }

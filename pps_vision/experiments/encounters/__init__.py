"""Encounters of the arm with objects, by controller: touched, distance left, lead and needless commands."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from pps_vision.experiments.encounters import activation, controllers, learning, sessions, unknown
from pps_vision.experiments.study import Part, PartsStudy


@dataclass(frozen=True)
class Encounters(PartsStudy):
    """Parts: all controllers without rendering; ours beside controls that have learned nothing, on robots with R's
    errors; the meaning of an activation; surfaces that geometry does not know; ours and such a control rendered; R's
    sessions of avoidance and reaching (R Figs 10, 11, S1, S2, Tables 6, 7); on request, the search for the
    baselines' parameters."""

    MINUTES: ClassVar[int] = 84
    SHORT: ClassVar[Mapping[str, Any]] = {
        **dict.fromkeys(("n_rendered", "n_tuning", "draws"), 1),
        "share": 0.02,
    }
    PARTS: ClassVar[Mapping[str, Part]] = {
        "controllers": Part(controllers.run, table=controllers.tables),
        "learning": Part(learning.run, learning.chart, learning.table),
        "activation": Part(activation.run, table=activation.table),
        "unknown": Part(unknown.run, table=unknown.tables),
        "rendered": Part(controllers.run_rendered, table=controllers.rendered_table),
        "sessions": Part(sessions.run, sessions.chart, sessions.table),
        "tuning": Part(controllers.tune, on_request=True),
    }

    n: int = 200
    """Encounters of each of press and through; a fifth as many of stop and graze, 6 % of each harmless kind, 10 %
    of `reach`; a tenth as many robots that misjudge by each error, 2 % as many with each unknown surface."""
    n_rendered: int = 6
    """Rendered encounters of each approaching kind; six tenths as many of each harmless kind."""
    n_tuning: int = 12  # the same of the search for parameters
    draws: int = 30  # parameters tried for each controller
    errors_m: tuple[float, ...] = (0.0, 0.03, 0.05)
    """Error (RMS) of the position of a touching object relative to the taxel: R's five sources, scaled."""
    tuning_seed: int = 9783  # seed of the search; not `seed`, which is that of the encounters that count
    avoidance_min: float = 20.0  # length of the sessions of avoidance
    reaching_min: float = 10.0  # length of the session of reaching
    share: float = 1.0  # share of R's numbers of training approaches (Table 5), and of the sessions' lengths
    workers: int = 1  # parallel processes

    @property
    def n_robots(self) -> int:
        """Robots that misjudge by each error."""
        return max(round(0.1 * self.n), 2)

    @property
    def n_subjects(self) -> int:
        """Robots with each surface that geometry does not know."""
        return max(round(0.02 * self.n), 2)

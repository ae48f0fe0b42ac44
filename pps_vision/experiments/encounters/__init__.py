"""Encounters of the arm with objects, by controller: touched, distance left, lead and needless commands."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from pps_vision.experiments.encounters import controllers, sessions
from pps_vision.experiments.encounters.controllers import EncountersParameters
from pps_vision.experiments.study import Part


@dataclass(frozen=True)
class Encounters(EncountersParameters):
    """Parts: all controllers without rendering; ours rendered beside not rendered; R's sessions of avoidance and
    reaching (R Figs 10, 11, S1, S2, Tables 6, 7); the search for the baselines' parameters."""

    SHORT: ClassVar[Mapping[str, Any]] = {"n_rendered": 1, "n_tuning": 1, "draws": 1, "share": 0.02}
    PARTS: ClassVar[Mapping[str, Part]] = {
        "controllers": Part(controllers.run, controllers.chart, controllers.tables),
        "rendered": Part(controllers.run_rendered, table=controllers.rendered_table),
        "sessions": Part(sessions.run, sessions.chart, sessions.table),
        "tuning": Part(controllers.tune),
    }

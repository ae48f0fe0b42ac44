"""R Table 5: minutes, trials and samples of the five sessions, beside the paper's."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from pps_vision.experiments.pps.movements import SessionName
from pps_vision.experiments.pps.perceived import Session, perceive, train_memory
from pps_vision.experiments.pps.trials import SessionStudy
from pps_vision.experiments.tables import Table

PAPER: dict[SessionName, dict[str, int]] = {
    "motor": {"minutes": 31, "trials": 82, "samples": 3512, "samples_of_shown_taxel": 1625},
    "visual": {"minutes": 30, "trials": 45, "samples": 1166, "samples_of_shown_taxel": 376},
    "inner": {"minutes": 23, "trials": 53, "samples": 1886, "samples_of_shown_taxel": 627},
    "outer": {"minutes": 17, "trials": 34, "samples": 1348, "samples_of_shown_taxel": 451},
    "palm": {"minutes": 44, "trials": 77, "samples": 2833, "samples_of_shown_taxel": 944},
}


@dataclass(frozen=True)
class Table5(SessionStudy):
    """Minutes, trials and samples of R's five sessions (R Table 5).

    A sample is a step of 50 ms in which some taxel of the part perceives the object. Our minutes are those of the
    movements; R's include the way back and the experimenter's pauses.
    """

    SHORT: ClassVar[Mapping[str, Any]] = {"share": 0.1}

    def run(self) -> dict[str, Any]:
        """Return ours and the paper's numbers by session."""
        found = {
            name: {"ours": count(Session.of(name, self.seen(name))), "paper": paper} for name, paper in PAPER.items()
        }
        return {"sessions": found}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return ours / the paper's, and the taxels ever touched of those aimed at."""
        columns = list(PAPER["motor"])
        rows = [
            [name, *(f"{of['ours'][key]:g} / {of['paper'][key]}" for key in columns), of["ours"]["taxels_touched"]]
            for name, of in numbers["sessions"].items()
        ]
        return {"": Table(["session (ours / R)", *(key.replace("_", " ") for key in columns), "taxels touched"], rows)}


def count(session: Session) -> dict[str, Any]:
    """Return the columns of Table 5."""
    touched = np.any([trial.touched for trial in session.trials], axis=0)[list(session.aimed)]
    return {**counted(session), "taxels_touched": f"{touched.sum()} of {len(session.aimed)}"}


def counted(session: Session) -> dict[str, float]:
    """Return the columns of Table 5 that the paper has."""
    memory = train_memory(session.trials)
    return {
        "minutes": round(sum(float(np.ptp(trial.stamps_s)) for trial in session.trials) / 60, 2),
        "trials": len(session.trials),
        "samples": sum(int(np.isfinite(perceive(trial)[0]).any(axis=1).sum()) for trial in session.trials),
        "samples_of_shown_taxel": int(memory.counts[session.shown_taxel(memory)].sum()),
    }

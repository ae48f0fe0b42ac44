"""`pps-vision session`: the training sessions of the papers' robots, rendered as recordings."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from pps_vision.errors import InputError


@dataclass(frozen=True)
class Session:
    """Render the sessions in which the papers' robots learned, as recordings with touches and truth.

    double-touch (R): the right index finger, with a green marker, touches the left forearm, for `pps-vision learn OUT/*
    --mode marker`. objects (R): a ball and a cube in a hand touch the skin in turn, for `pps-vision learn OUT/*`.
    babbling (J): an arm moves at random with a green marker about its palm, for `pps-vision reach train --from OUT`.
    """

    name: Positional[Literal["double-touch", "objects", "babbling"]]
    """What the robot does."""
    out: Path
    """Folder to write, new or empty: a recording for each trial, 001, 002, …; of babbling, or of one trial, itself."""
    trials: int | None = None
    """Number of touches; default: as many as in R. A touch is rendered in about 10 s."""
    part: Literal["inner", "outer", "palm"] = "inner"
    """objects: inner or outer left forearm, or right palm."""
    arm: Literal["left", "right"] = "right"
    """babbling: the arm."""
    postures: int = 20_000
    """babbling: number of stereo pairs, 20 a second; 1000 are rendered in about two minutes."""
    noise: float = 2.0
    """Standard deviation of the pixel noise, grey levels of 255."""
    seed: int = 0
    """Seed of the movements and the noise."""

    def run(self) -> None:
        from pps_vision.app import sessions
        from pps_vision.app.encounters.encounter import TRIALS

        if (self.trials is not None and self.trials < 1) or self.postures < 2:
            counts = f"--trials {self.trials}, --postures {self.postures}"
            raise InputError("session", f"{counts}; expected at least one trial and two postures")
        if self.name == "babbling":
            movements = [sessions.babbling(self.arm, self.postures, self.seed)]
        else:
            session = self.part if self.name == "objects" else "visual"
            movements = list(sessions.movements(session, self.trials or TRIALS[session], self.seed))
        folders = sessions.record(movements, self.out, self.noise, self.seed)
        print(f"{len(folders)} recording{'s'[: len(folders) > 1]} → {self.out}")

"""`pps-vision trials`: learn from one session of recorded trials and predict the touches of another."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional


@dataclass(frozen=True)
class Trials:
    """Learn from recorded trials of a robot which taxels an approach will touch, and predict those of others.

    Writes a row per trial and taxel, both counted from 0: trial,taxel,activation,lower,upper,outcome.  Activation is
    the probability of touch, lower and upper the ends of its 90 % credible interval, outcome 1 (touched) or 0.
    Of each trial, to learn from or to predict, only samples up to --horizon-s before its end are used.  Trials
    to learn from are in the order of time: paths move a prediction away from the taxel's rate of touch only as far as
    they predicted parts of that session from its other parts.  How far the session to predict is displaced as a whole
    is estimated from each trial, for it and those after it.
    Prints AUROC, over all and within each taxel, and Brier score beside those of each taxel's rate of touch, and how
    much lower the Brier score is, with a 95 % interval over the trials.
    """

    train: Positional[Path]
    """Trials to learn from (.npz: position_m, velocity_m_s, offsets, outcome)."""
    test: Positional[Path]
    """Trials to predict, of the same taxels."""
    out: Path
    """Where to write the predictions (.csv)."""
    horizon_s: float = 0.15
    """How long before its end a trial is predicted; nothing later is used."""

    def run(self) -> None:
        """Learn, predict, write, and say how good it was."""
        from pps_vision.app.trials import trials

        trials(self.train, self.test, self.out, self.horizon_s)

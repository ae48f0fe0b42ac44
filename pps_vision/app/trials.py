"""`pps-vision trials`: learn from one session of recorded trials and foretell the touches of another."""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from learning.passing import Foretold, PassingParams, foretell_session, learn_passing
from learning.scores import auroc, brier
from learning.trials import Trial, load_trials, touch_rates
from pps_vision.recordings.outputs import whole_file
from pps_vision.recordings.tables import write_table
from pps_vision.types import Array, Mask

COLUMNS = ("trial", "taxel", "activation", "lower", "upper", "outcome")


@dataclass(frozen=True)
class Trials:
    """Learn from recorded trials of a robot which taxels an approach will touch, and foretell those of others.

    Writes a row per trial and taxel, both counted from 0: trial,taxel,activation,lower,upper,outcome.  Activation is
    the probability of touch, lower and upper the ends of its 90 % credible interval, outcome 1 (touched) or 0.
    Of each trial, to learn from or to foretell, only samples up to --horizon-s before its end are used.  How far
    the session to foretell is displaced as a whole, each trial tells for itself and those after it.
    Prints AUROC, over all and within each taxel, and Brier score beside those of each taxel's rate of touch.
    """

    train: tyro.conf.Positional[Path]
    """Trials to learn from (.npz: position_m, velocity_m_s, offsets, outcome)."""
    test: tyro.conf.Positional[Path]
    """Trials to foretell, of the same taxels."""
    out: Path
    """Where to write the predictions (.csv)."""
    horizon_s: float = 0.15
    """How long before its end a trial is foretold; nothing later is used."""

    def run(self) -> None:
        """Learn, foretell, write, and say how good it was."""
        params = PassingParams(horizon_s=self.horizon_s)
        train, test = load_trials(self.train), load_trials(self.test)
        _refuse_what_teaches_nothing(self.train, train, self.test, test)
        with whole_file(self.out) as partial:
            foretold = foretell_session(params, learn_passing(params, train), test)
            touched = np.array([trial.touched for trial in test])
            write_table(partial, COLUMNS, _rows(foretold, touched))
        for path, trials in ((self.train, train), (self.test, test)):
            _report_unknown(path, trials)
        late = int((~foretold.in_reach).sum())
        if late:
            print(
                f"{self.test}: {late} of {touched.size} pairs of trial and taxel have no sample in reach "
                f"{self.horizon_s:g} s before the end: given the taxel's rate of touch",
                file=sys.stderr,
            )
        _print_scores(foretold.probability, touch_rates(train), touched)
        print(f"{len(test)} trials, {self.horizon_s:g} s ahead → {self.out}")


def _refuse_what_teaches_nothing(
    train_path: Path, train: tuple[Trial, ...], test_path: Path, test: tuple[Trial, ...]
) -> None:
    n, n_test = len(train[0].touched), len(test[0].touched)
    if n != n_test:
        raise ValueError(f"{test_path}: {n_test} taxels; expected the {n} of {train_path}")
    if not any(np.isfinite(trial.d_m).all(axis=-1).any() for trial in train):
        raise ValueError(f"{train_path}: no position is finite; expected metres from each taxel")
    rates = touch_rates(train)
    if rates.max() == 0 or rates.min() == 1:
        raise ValueError(f"{train_path}: outcome is {1 if rates.max() else -1} throughout; expected both 1 and -1")


def _rows(foretold: Foretold, touched: Mask) -> list[tuple[object, ...]]:
    p, low, high = foretold.probability, foretold.lower, foretold.upper
    return [(t, k, p[t, k], low[t, k], high[t, k], touched[t, k]) for t, k in np.ndindex(*touched.shape)]


def _report_unknown(path: Path, trials: tuple[Trial, ...]) -> None:
    unknown = [int((~np.isfinite(trial.d_m).all(axis=-1)).sum()) for trial in trials]
    if sum(unknown):
        where = ", ".join(str(t) for t, n in enumerate(unknown) if n)
        print(f"skipped: {path}: {sum(unknown)} positions that are not finite, in trials {where}", file=sys.stderr)


def _print_scores(probability: Array, rates: Array, touched: Mask) -> None:
    base = np.tile(rates, (len(touched), 1))
    columns = ((auroc(touched, p), brier(touched, p)) for p in (probability, base))
    print(f"{'':12}{'learned':>9}{'base rate':>11}")
    for name, values in zip(("AUROC", "Brier"), zip(*columns, strict=True), strict=True):
        print(f"{name:12}{values[0]:9.3f}{values[1]:11.3f}{_one_class(touched) if name == 'AUROC' else ''}")
    for k, happened in enumerate(touched.T):
        within = auroc(happened, probability[:, k]), auroc(happened, base[:, k])
        print(f"  taxel {k:<4}{within[0]:9.3f}{within[1]:11.3f}{_one_class(happened)}")


def _one_class(happened: Mask) -> str:
    return "" if happened.any() and not happened.all() else f"  ({'always' if happened.any() else 'never'} touched)"

"""Learn from one session of recorded trials and predict the touches of another."""

import sys
from pathlib import Path

import numpy as np

from learning.pps.contact import ContactPrediction, learn_contact, predict_session
from learning.pps.scores import auroc, brier, brier_gain
from learning.pps.trials import Trial, load_trials, touch_rates
from pps_vision.errors import InputError
from pps_vision.recordings.outputs import whole_file
from pps_vision.recordings.tables import write_table
from pps_vision.types import Array, Mask

COLUMNS = ("trial", "taxel", "activation", "lower", "upper", "outcome")


def trials(train_path: Path, test_path: Path, out: Path, horizon_s: float) -> None:
    """Learn, predict, write, and say how good it was; the arguments are those of `pps-vision trials`."""
    if train_path.exists() and test_path.exists() and train_path.samefile(test_path):
        raise InputError(test_path, "is also TRAIN; expected other trials than those learned from")
    with whole_file(out, [train_path, test_path]) as partial:
        train, test = load_trials(train_path), load_trials(test_path)
        _refuse_what_teaches_nothing(train_path, train, test_path, test)
        predicted = predict_session(horizon_s, learn_contact(horizon_s, train), test)
        touched = np.array([trial.touched for trial in test])
        write_table(partial, COLUMNS, _rows(predicted, touched))
    for path, session in ((train_path, train), (test_path, test)):
        _report_unknown(path, session)
    lost = int(predicted.lost.sum())
    far = int((~predicted.in_reach).sum()) - lost
    for n, what in ((far, "are out of reach"), (lost, "are lost")):
        if n:
            print(
                f"{test_path}: {n} of {touched.size} pairs of trial and taxel {what} {horizon_s:g} s before the end: "
                "given the taxel's rate of touch in such trials",
                file=sys.stderr,
            )
    _print_scores(predicted.probability, touch_rates(train), touched)
    print(f"{len(test)} trials, {horizon_s:g} s ahead → {out}")


def _refuse_what_teaches_nothing(
    train_path: Path, train: tuple[Trial, ...], test_path: Path, test: tuple[Trial, ...]
) -> None:
    n, n_test = len(train[0].touched), len(test[0].touched)
    if n != n_test:
        raise InputError(test_path, f"{n_test} taxels; expected the {n} of {train_path}")
    if not any(np.isfinite(trial.d_m).all(axis=-1).any() for trial in train):
        raise InputError(train_path, "no position is finite; expected metres from each taxel")
    rates = touch_rates(train)
    if rates.max() == 0 or rates.min() == 1:
        raise InputError(train_path, f"outcome is {1 if rates.max() else -1} throughout; expected both 1 and -1")


def _rows(predicted: ContactPrediction, touched: Mask) -> list[tuple[object, ...]]:
    p, low, high = predicted.probability, predicted.lower, predicted.upper
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
    if len(touched) > 1:
        gain, low, high = brier_gain(touched, probability, base)
        print(
            f"Brier below the base rate's by {gain:+.4f} ({low:+.4f} to {high:+.4f}, 95 % over {len(touched)} trials)"
        )
    for k, happened in enumerate(touched.T):
        within = auroc(happened, probability[:, k]), auroc(happened, base[:, k])
        print(f"  taxel {k:<4}{within[0]:9.3f}{within[1]:11.3f}{_one_class(happened)}")


def _one_class(happened: Mask) -> str:
    return "" if happened.any() and not happened.all() else f"  ({'always' if happened.any() else 'never'} touched)"

"""Tests of a laboratory's own recordings: their tracking error must stay below a limit.

from pps_vision.testing import check_error

def test_error_stays_below_2_mm():
    check_error(["recordings/a", "recordings/b"], rmse_mm=2.0)
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pps_vision.app.evaluate import Path3D, Score, evaluate, read_path
from pps_vision.app.track import track
from pps_vision.errors import InputError
from pps_vision.recordings.open import open_recording
from pps_vision.recordings.recording import Recording
from tracking import Mode


def check_error(
    recordings: Sequence[Recording | Path | str],
    rmse_mm: float,
    lost_share: float = 1.0,
    *,
    truth: Sequence[Path | str] = (),
    mode: Mode = "generic",
    align: bool = False,
    lag: bool = False,
) -> list[Score]:
    """Track recordings and return their scores.

    Args:
        recordings: Recordings, or what `pps_vision.open_recording` opens.
        rmse_mm: Largest root mean square error of the known positions of each.
        lost_share: Largest share of the truth's stamps without a position.
        truth: A file of the true path for each, as `pps-vision evaluate` reads it; default: the recordings' own.
        mode: As for `pps_vision.track`.
        align: As for `pps-vision evaluate`.
        lag: As for `pps-vision evaluate`.

    Raises:
        AssertionError: A recording exceeds a limit; the message has the scores of all.
        InputError: A recording or its truth cannot be used.
    """
    scores = []
    for k, source in enumerate(recordings):
        recording = source if isinstance(source, Recording) else open_recording(source)
        name, own_rows = recording.name, recording.truth
        unstated = np.full((len(own_rows), 3, 3), np.nan)
        position = np.reshape([row.position for row in own_rows], (-1, 3))
        own = Path3D(name, np.array([row.stamp_s for row in own_rows]), position, unstated)
        true = read_path(Path(truth[k])) if truth else own
        if not len(true.stamps_s):
            raise InputError(recording.name, "holds no truth.csv; expected one there or by truth")
        path = track(recording, mode, objects=1).arrays()
        known = np.isfinite(path.position).all(axis=1)
        covs = path.cov[known][:, :3, :3]
        tracked = Path3D(name, path.stamps_s[known], path.position[known], covs, int(np.sum(~known)))
        scores.append(evaluate(tracked, true, lag, align))
    failed = [score for score in scores if not (score.rmse_mm <= rmse_mm and score.lost_share <= lost_share)]
    if failed:
        rows = [
            f"{score.name}: {score.rmse_mm:.2f} mm, {100 * score.lost_share:.1f} % lost, "
            f"{score.unknown} of {score.rows} pairs without a position{' (fails)' * (score in failed)}"
            for score in scores
        ]
        limits = f"expected at most {rmse_mm} mm and {100 * lost_share:g} % lost"
        raise AssertionError("\n".join([f"{len(failed)} of {len(scores)} recordings: {limits}", *rows]))
    return scores

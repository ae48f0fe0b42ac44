"""How the report draws the reachability of what is tracked."""

import numpy as np
from matplotlib.figure import Figure

from pps_vision.app.report.figures import episodes
from pps_vision.app.simulation import EpisodeLog
from pps_vision.types import Reachability, ReachStatus, Status


def test_the_report_draws_it_beside_the_activations() -> None:
    """In the last three frames nothing is tracked."""
    T = 12
    zeros, ones, degree = np.zeros(T), np.ones((T, 2)), np.linspace(0.2, 0.9, T - 3)
    known = [
        Reachability(0.0, np.zeros(3), r, r, ReachStatus.REACHABLE if r > 0.5 else ReachStatus.UNREACHABLE)
        for r in degree
    ]
    reachability = (*known, *[Reachability.without_answer(0.0, ReachStatus.UNKNOWN)] * 3)
    log = EpisodeLog(
        "turning", ("a:1", "a:2"), 0.05 * np.arange(T), (Status.TRACKING,) * T, np.zeros((T, 3)), np.zeros((T, 3)),
        np.zeros((T, 3)), 0.1 * ones, 0.2 * ones, zeros, zeros > 0, ones > 2, zeros, reachability,
    )  # fmt: skip
    figure = episodes([log], 0.4)
    assert isinstance(figure, Figure)
    axis = figure.axes[3]
    np.testing.assert_array_equal(axis.lines[0].get_ydata(), [*degree, np.nan, np.nan, np.nan])
    assert axis.get_ylabel().startswith("degree of reach")
    green, grey = (area.get_datalim(axis.transData).x1 for area in axis.collections[:2])
    assert 0.05 * (T - 3) > green > grey

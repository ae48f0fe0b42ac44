"""Learned maps of one taxel: their charts and the width of their ridge."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from learning.pps.memory import Counts, MemoryParams
from pps_vision.app.report.figures import draw_landscape
from pps_vision.experiments.charts import panels
from pps_vision.experiments.pps.taxel_offsets import orthogonal_line

FINE = MemoryParams(bins=(120, 60))
"""Bins of 2.5 mm and 50 ms, in which the ridge is measured."""


def landscape_chart(landscapes: Mapping[str, ArrayLike], columns: int) -> Figure:
    """Draw the activation over D and TTC of each title's map, as R's figures do."""
    figure, axes = panels(len(landscapes), columns, 3.2, 2.8)
    for axis, (title, activation) in zip(axes, landscapes.items(), strict=True):
        draw_landscape(axis, activation)
        axis.set_title(title, fontsize=9)
    figure.colorbar(axes[0].images[0], ax=axes, label="activation", shrink=0.7)
    figure.supxlabel("distance D (cm)", fontsize=9)
    figure.supylabel("time to contact TTC (s)", fontsize=9)
    return figure


def ridge_width(counts: Counts) -> float:
    """Return the standard deviation in m of the positive samples' D about their line, of `FINE` counts
    (D bins, TTC bins, 2); NaN without a line."""
    (d0, d1), (t0, t1) = FINE.distance_range_m, FINE.ttc_range_s
    n_d, n_t = FINE.bins
    D, TTC = np.meshgrid(
        d0 + (d1 - d0) * (np.arange(n_d) + 0.5) / n_d, t0 + (t1 - t0) * (np.arange(n_t) + 0.5) / n_t, indexing="ij"
    )
    positive = counts[..., 0]
    line = orthogonal_line(D, TTC, positive)
    if line is None:
        return float("nan")
    return float(np.sqrt((positive * (D - line.offset - line.slope * TTC) ** 2).sum() / positive.sum()))

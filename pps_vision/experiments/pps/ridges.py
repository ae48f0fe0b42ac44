"""The ridge of positive samples in a taxel's map: its line, offset and width (R Fig 8); charts of maps."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from learning.pps.memory import Counts, MemoryParams, PPSMemory
from pps_vision.app.report.figures import draw_landscape
from pps_vision.experiments.charts import panels
from pps_vision.types import Array

FINE = MemoryParams(bins=(120, 60))  # bins of 2.5 mm and 50 ms, in which the ridge is measured


def orthogonal_line(x: ArrayLike, y: ArrayLike, weights: ArrayLike) -> tuple[float, float]:
    """Return offset and slope of x = offset + slope · y, the line of least weighted squared orthogonal distances.

    NaN where every line fits as well, or a line along x fits best. The arguments have as many elements.
    """
    points = np.stack([np.ravel(x), np.ravel(y)]).astype(float)
    w = np.ravel(weights).astype(float)
    if w.sum() == 0:
        return np.nan, np.nan
    center = points @ w / w.sum()
    deviations = points - center[:, None]
    variances, directions = np.linalg.eigh((deviations * w) @ deviations.T)
    along_x, along_y = directions[:, 1]
    if variances[1] - variances[0] <= 1e-12 * variances[1] or abs(along_y) < 1e-9:
        return np.nan, np.nan
    slope = along_x / along_y
    return float(center[0] - slope * center[1]), float(slope)


def bin_centers(params: MemoryParams) -> tuple[Array, Array]:
    """Return D in m and TTC in s (D bins, TTC bins) of the bins' centres."""
    ranges = zip((params.distance_range_m, params.ttc_range_s), params.bins, strict=True)
    D, TTC = np.meshgrid(*(low + (np.arange(n) + 0.5) * (high - low) / n for (low, high), n in ranges), indexing="ij")
    return D, TTC


def offsets(memory: PPSMemory) -> Array:
    """Return the distance (n,) m at which each taxel's line crosses TTC = 0; NaN without a line.

    Without errors this is the radius of the object (R, "Analysis of the systematic errors"). Distances are in metres
    and times in seconds: nearly all scatter is then along the distance, as in the data.
    """
    D, TTC = bin_centers(memory.params)
    return np.array([orthogonal_line(D, TTC, positive)[0] for positive in memory.counts[..., 0]])


def ridge_width(counts: Counts) -> float:
    """Return the standard deviation in m of the positive samples' D about their line; NaN without a line.

    `counts` (D bins, TTC bins, 2) are of the bins `FINE`.
    """
    D, TTC = bin_centers(FINE)
    positive = counts[..., 0]
    offset, slope = orthogonal_line(D, TTC, positive)
    return float(np.sqrt((positive * (D - offset - slope * TTC) ** 2).sum() / max(positive.sum(), 1)))


def landscape_chart(landscapes: Mapping[str, ArrayLike], columns: int) -> Figure:
    """Draw the activation over D and TTC of each map, as R's figures do, under its title."""
    figure, axes = panels(len(landscapes), columns, 3.2, 2.8)
    for axis, (title, activation) in zip(axes, landscapes.items(), strict=True):
        draw_landscape(axis, activation)
        axis.set_title(title, fontsize=9)
    figure.colorbar(axes[0].images[0], ax=axes, label="activation", shrink=0.7)
    figure.supxlabel("distance D (cm)", fontsize=9)
    figure.supylabel("time to contact TTC (s)", fontsize=9)
    return figure

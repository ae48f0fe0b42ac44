"""Times at which something holds, as shades of a figure."""

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from pps_vision.types import Array


def shade(axis: Axes, t: Array, where: ArrayLike, color: str, alpha: float = 0.2) -> None:
    """Colour the times (T,) at which `where` (T,) holds, each half the way to its neighbours."""
    edges = np.concatenate([t[:1], 0.5 * (t[1:] + t[:-1]), t[-1:]])
    over, holds = axis.get_xaxis_transform(), np.repeat(np.asarray(where, bool), 2)
    axis.fill_between(np.repeat(edges, 2)[1:-1], 0, 1, where=holds, transform=over, color=color, alpha=alpha, lw=0)

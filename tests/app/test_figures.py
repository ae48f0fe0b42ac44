"""Figures of the reports show the numbers that they are given, in the units of their labels."""

import numpy as np
from matplotlib.axes import Axes

from pps_vision.types import Array


def lines(axis: Axes) -> list[tuple[Array, Array]]:
    return [(np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float)) for line in axis.lines]

"""Tracking of objects in stereo images; `tracking.tracker` joins the parts.

This module holds the option names of the command line, to be imported without the tracker's dependencies.
"""

from typing import Literal

Mode = Literal["generic", "marker"]
FollowedBy = Literal["colour", "background", "hue"]

DEFAULT_OBJECTS = 4  # largest number of objects that `track` follows at a time
DEFAULT_ORDER = 4  # order of the Kalman filter: position, velocity, acceleration and jerk (R)

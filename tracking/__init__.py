"""Tracking of one object in stereo images; `tracking.tracker` joins the parts.

This module holds the names that a user chooses from; importing them loads nothing else.
"""

from typing import Literal

Mode = Literal["generic", "marker"]
FollowedBy = Literal["colour", "background", "hue"]

DEFAULT_ORDER = 4  # order of the Kalman filter: position, velocity, acceleration and jerk (R)

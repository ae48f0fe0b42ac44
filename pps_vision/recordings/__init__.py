"""Readers and writers of recordings, calibrations and results.

This module holds the names that a user chooses from; importing them loads nothing else.
"""

from typing import Literal

Form = Literal["tum", "anipose", "mot", "coco", "ros2"]
"""Forms of other tools in which tracks and detections are written; `pps_vision.recordings.exchange` says what is in
them."""

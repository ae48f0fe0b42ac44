"""Readers and writers of recordings, calibrations and results.

This module holds the names that a user chooses from; importing them loads no other module.
"""

from typing import Literal

SUMMARY = "summary.json"
BATCH = "batch.csv"
REPORT = "report.html"
"""Files of a tracked recording or of a batch, whose table is `BATCH`."""
MAX_SKEW_S = 0.02
"""Left and right images further apart in time are no pair, unless the user says otherwise."""
Form = Literal["tum", "anipose", "mot", "coco", "ros2"]
"""Forms of other tools in which tracks and detections are written; `pps_vision.recordings.exchange` says what is in
them."""
Layout = Literal["lr", "rl", "tb", "bt"]
"""Where an image shows the views of the left and the right camera: left to right, or top to bottom."""

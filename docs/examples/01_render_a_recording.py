"""Render a short recording of a ball that an iCub watches, and read it."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import pps_vision as pv

with TemporaryDirectory() as folder:
    recording = pv.render("ball", "circle", Path(folder) / "rec", seconds=1.0, noise=2.0, seed=1)
    print(f"{len(recording)} stereo pairs of {recording.image_size} pixels, {recording.fps:.0f} a second")
    offsets_px = []
    for frame, truth in zip(recording, recording.truth, strict=True):
        view = recording.rig.view_of(frame)  # both cameras at the time of the images
        offsets_px.append(np.linalg.norm(view.left.project(truth.position) - truth.left_px))
    print(f"the true position projects {max(offsets_px):.4f} px from the true pixel, at most")
    print(f"at {frame.stamp_s:.2f} s the ball is {np.linalg.norm(truth.position - view.left.center):.3f} m away")
    u, v = np.round(truth.left_px).astype(int)
    print(f"its colour there: {frame.left[v, u]}")

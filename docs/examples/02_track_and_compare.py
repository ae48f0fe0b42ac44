"""Track a recording and compare the path with the truth."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import pps_vision as pv

with TemporaryDirectory() as folder:
    recording = pv.render("ball", "figure8", Path(folder) / "rec", seconds=1.5, noise=2.0, seed=2)

    for step in pv.track(recording):  # one result per stereo pair
        if step.track.is_known:
            print(f"first known at {step.track.stamp_s:.2f} s: {np.round(step.track.position, 3)} m")
            break

    path = pv.track(recording).arrays()  # or the whole path at once

tracking = path.status == "tracking"
truth = np.array([row.position for row in recording.truth])
velocity = np.array([row.velocity for row in recording.truth])
error_mm = 1000 * np.linalg.norm(path.position - truth, axis=1)[tracking]
error_m_s = np.linalg.norm(path.velocity - velocity, axis=1)[tracking]
sigma_mm = 1000 * np.sqrt(np.trace(path.cov[tracking, :3, :3], axis1=1, axis2=2))
print(f"tracked in {tracking.sum()} of {len(tracking)} pairs")
print(f"position error {np.sqrt(np.mean(error_mm**2)):.2f} mm RMS, expected {np.sqrt(np.mean(sigma_mm**2)):.2f} mm")
print(f"velocity error {np.median(error_m_s[5:]):.3f} m/s median, speed {np.linalg.norm(velocity[-1]):.3f} m/s")

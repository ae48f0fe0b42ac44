"""Smooth a path offline, and plot it beside the causal one."""

from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib

matplotlib.use("Agg")  # draws to files

import matplotlib.pyplot as plt
import numpy as np

import pps_vision as pv

with TemporaryDirectory() as folder:
    recording = pv.render("marker", "figure8", Path(folder) / "rec", seconds=1.5, noise=4.0, seed=4)
    run = pv.track(recording, mode="marker")  # iterating it again tracks it again, to the same path
    paths = {"causal": run.arrays(), "smoothed": run.arrays(smooth=True)}

    truth = np.array([row.velocity for row in recording.truth])
    figure, axis = plt.subplots()
    for name, path in paths.items():
        tracking = path.status == "tracking"
        error = np.linalg.norm(path.velocity - truth, axis=1)
        axis.plot(path.stamps_s, error, label=name)
        print(f"{name}: velocity error {1000 * np.sqrt(np.mean(error[tracking] ** 2)):.1f} mm/s RMS")
    axis.set(xlabel="time (s)", ylabel="velocity error (m/s)")
    axis.legend()
    figure.savefig(Path(folder) / "velocity.png")
    print(f"figure of {(Path(folder) / 'velocity.png').stat().st_size // 1000} kB")

"""What a reachable-space map holds, in slices of equal vergence (in the manner of J Figs 5 and 8)."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from learning.reach.map import ReachableMap
from pps_vision.app import figures  # noqa: F401  (chooses a backend that needs no display)
from pps_vision.robot.gaze import fixation_points
from pps_vision.robot.icub import load_icub

_VERGENCES_DEG = (10, 13, 17, 22, 30, 45, 60, 80)


def slices(reachable_map: ReachableMap) -> Figure:
    """Degree of reachability over yaw and pitch, the border drawn; vergence stands for distance."""
    limits = reachable_map.limits
    yaw, pitch = (np.linspace(*ends, 120) for ends in (limits.yaw_rad, limits.pitch_rad))
    Y, P = np.meshgrid(yaw, pitch)
    shown = [v for v in _VERGENCES_DEG if limits.lower[2] <= np.deg2rad(v) <= limits.upper[2]]
    figure, axes = plt.subplots(
        2, -(-len(shown) // 2), figsize=(2.5 * -(-len(shown) // 2) + 1, 5), sharex=True, sharey=True, squeeze=False,
        layout="constrained",
    )  # fmt: skip
    robot = load_icub()
    image = None
    extent = np.rad2deg([*limits.yaw_rad, *limits.pitch_rad]).tolist()
    for axis, vergence in zip(axes.flat, shown, strict=False):
        gaze = np.stack([Y.ravel(), P.ravel(), np.full(Y.size, np.deg2rad(vergence))], axis=1)
        verdict = reachable_map.query(gaze)
        image = axis.imshow(
            verdict.degree.reshape(Y.shape), origin="lower", extent=extent, vmin=0, vmax=1, cmap="RdYlGn", aspect="auto"
        )
        chance = verdict.probability.reshape(Y.shape)
        if chance.min() < 0.5 < chance.max():
            axis.contour(np.rad2deg(yaw), np.rad2deg(pitch), chance, levels=[0.5], colors="0.2", linewidths=1)
        left, right = robot.eye_poses(np.zeros(robot.n_joints))
        ahead = fixation_points(robot, np.deg2rad([[0.0, 0.0, vergence]]))[0]
        distance = np.linalg.norm(ahead - 0.5 * (left + right)[:3, 3])
        axis.set_title(f"vergence {vergence}° ({100 * distance:.0f} cm)", fontsize=9)
    for axis in axes.flat[len(shown) :]:
        axis.set_visible(False)
    if image is not None:
        figure.colorbar(
            image, ax=axes, label=f"degree of reachability R ({reachable_map.measure}; reachable above 0.5)", shrink=0.8
        )
    who = {"both": "both hands at once"}.get(reachable_map.side, f"the {reachable_map.side} hand")
    if reachable_map.end_point != "palm":
        who = f"taxel {reachable_map.end_point}"
    figure.suptitle(f"What {who} can reach of what the eyes fixate; line: the border", fontsize=10)
    figure.supxlabel("neck yaw (°)", fontsize=9)
    figure.supylabel("neck pitch (°)", fontsize=9)
    return figure

"""What stamps that are a little off cost while the head turns: the joints are then those of another moment."""

from dataclasses import replace

import numpy as np

from pps_vision.geometry.camera import StereoView
from pps_vision.geometry.se3 import move_points
from pps_vision.types import Array, Observation3D


class PoseError:
    """Widens observations by how far the head would have carried them during `stamp_error_s` (a standard
    deviation); remembers where the eyes were."""

    def __init__(self, stamp_error_s: float) -> None:
        self.stamp_error_s = stamp_error_s
        self._before: tuple[StereoView, float] | None = None

    def widen(self, observation: Observation3D | None, view: StereoView, stamp_s: float) -> Observation3D | None:
        """The observation with the covariance that it deserves at the head's present speed."""
        before, self._before = self._before, (view, stamp_s)
        if observation is None or before is None or self.stamp_error_s == 0:
            return observation
        off_m = self.stamp_error_s * carried(before[0], view, observation.p_root, stamp_s - before[1])
        return replace(observation, cov_root=observation.cov_root + np.outer(off_m, off_m))


def carried(before: StereoView, now: StereoView, p_root: Array, dt_s: float) -> Array:
    """(3,) m/s: how fast what rests in both images, and is now seen at `p_root` (3,), goes through the world as
    the head turns and the eyes converge from one view to the next."""
    slopes, drifts = [], []
    for then, eye in ((before.left, now.left), (before.right, now.right)):
        was = move_points(then.T_root_camera, move_points(eye.T_camera_root, p_root))
        slopes.append(eye.project_jacobian(p_root))
        drifts.append(slopes[-1] @ (p_root - was) / dt_s)
    J, drift = np.concatenate(slopes), np.concatenate(drifts)
    velocity: Array = np.linalg.solve(J.T @ J, J.T @ drift)
    return velocity

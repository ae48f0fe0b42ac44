"""Motion blur: the instants whose images are averaged to one exposure."""

import numpy as np

from pps_vision.geometry.camera import StereoRig, View
from pps_vision.robot.model import Robot
from pps_vision.types import Array
from rendering.fidelity import Fidelity
from rendering.scene import SceneState

_MAX_INSTANTS = 24


def instants(robot: Robot, rig: StereoRig, state: SceneState, blur_s: float, fidelity: Fidelity) -> list[SceneState]:
    """Return the states whose mean image is the exposure, evenly spaced about `state`.

    Their number grows with the fastest motion in view, one per `blur_step_px`.  Their spacing d gives the blur the
    variance of an open shutter: d²·(n² − 1)/12 = blur_s²/12.
    """
    drift_px = _drift_px(robot, rig, state, blur_s) if blur_s > 0 else 0.0
    if drift_px < 0.4 * fidelity.blur_step_px:
        return [state]
    n = int(np.clip(np.ceil(drift_px / fidelity.blur_step_px), 2, _MAX_INSTANTS))
    apart_s = blur_s / np.sqrt(n * n - 1)
    return [state.moved((k - 0.5 * (n - 1)) * apart_s) for k in range(n)]


def _drift_px(robot: Robot, rig: StereoRig, state: SceneState, blur_s: float) -> float:
    """Return the largest image motion of anything in view while the shutter is open, px."""
    ends = [state.moved(-blur_s / 2), state.moved(blur_s / 2)]  # opening and closing
    views = [rig.view(end.q_rad) for end in ends]
    movers = [_movers(robot, end) for end in ends]
    drift = 0.0
    for eyes in ([view.left for view in views], [view.right for view in views]):
        room = _points_of_room(eyes[0])
        px = np.array([eye.project(np.vstack([room, points])) for eye, points in zip(eyes, movers, strict=True)])
        visible = np.all((px >= 0) & (px < (eyes[0].camera.width, eyes[0].camera.height)), axis=(0, 2))
        drift = max(drift, np.linalg.norm(px[1, visible] - px[0, visible], axis=1).max(initial=0.0))
    return drift


def _points_of_room(eye: View) -> Array:
    """Return a grid of (25, 3) static points 0.5 m from the eye, spread over the image."""
    u, v = np.meshgrid(np.linspace(0, eye.camera.width - 1, 5), np.linspace(0, eye.camera.height - 1, 5))
    return eye.center + 0.5 * eye.rays(np.column_stack([u.ravel(), v.ravel()]))


def _movers(robot: Robot, state: SceneState) -> Array:
    """Return the positions (n, 3) of the robot's bodies, the props and the stimulus, root frame."""
    posture = robot.at(state.q_rad)
    places = {body.frame: body.T_frame_body[:3, 3] for body in robot.bodies}  # one body per rigid frame
    bodies = [posture.point(frame, place) for frame, place in places.items()]
    props = [np.full(3, np.nan) if prop is None else prop.position for prop in state.props]
    return np.array([*bodies, *props, *([] if state.position is None else [state.position])])

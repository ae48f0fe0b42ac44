"""The tracker with given outlines: exact, one-sided, jumping, of odd shape, at different stamps."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import Camera, StereoRig, View
from pps_vision.geometry.se3 import rotation_to, transform
from pps_vision.types import Array, Status, StereoFrame, Track3D
from tracking.camera_pose import CameraPoses
from tracking.camera_tracker import CameraState
from tracking.image_tracker import ImageDetection
from tracking.kalman import KalmanParams
from tracking.outline import Outline
from tracking.smoother import smoothed_steps
from tracking.tracker import (
    Tracker,
    TrackerParams,
    TrackerState,
    TrackerStep,
)

Pair = tuple[Outline | None, Outline | None]

CAMERA = Camera(64, 48, 220.0, 220.0, 31.5, 23.5)
LOOKING = rotation_to([-1.0, 0.0, 0.0])  # level, the root frame's x pointing backward
LEFT, RIGHT = (View(CAMERA, transform(LOOKING, 0.034 * sign * LOOKING[:, 0])) for sign in (-1, 1))
RIG = StereoRig(CAMERA, CAMERA, lambda _: (LEFT.T_root_camera, RIGHT.T_root_camera))
P = np.array([-0.5, 0.0, 0.0])
RADIUS_M = 0.02
DT = 0.05
STD_PX = 0.05
RADIUS_VAR = (0.05 / 220) ** 2


def seen(eye: View, p: Array, radius_m: float = RADIUS_M) -> Outline:
    x, y = eye.project(p)
    angle = float(np.arcsin(radius_m / np.linalg.norm(p - eye.center)))
    cov = STD_PX**2 * np.eye(2)
    return Outline(np.array([x, y]), cov, angle, RADIUS_VAR, (x - 9, y - 9, 18.0, 18.0), 254.0, False)


def both(p: Array = P, **of_outline: float) -> Pair:
    return seen(LEFT, p, **of_outline), seen(RIGHT, p, **of_outline)


def tracks(shapes: list[Pair], params: TrackerParams | None = None, right_later_s: float = 0.0) -> list[Track3D]:
    return [step.track for step in steps(shapes, params, right_later_s)]


def steps(shapes: list[Pair], params: TrackerParams | None = None, right_later_s: float = 0.0) -> list[TrackerStep]:
    """Tracker steps for which search and image tracker return these outlines."""
    rng = np.random.default_rng(3)
    tracker = Tracker(params or TrackerParams(), RIG, rng)
    steps = []
    for k, pair in enumerate(shapes):
        detected = tuple(outline and ImageDetection(outline, outline.box_px, 1.0) for outline in pair)
        images = rng.integers(0, 256, (2, CAMERA.height, CAMERA.width, 3), dtype=np.uint8)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(tracker, "_follow", lambda state, *_, detected=detected, **__: (state, detected))
            patch.setattr(tracker, "_acquire", lambda state, *_, detected=detected, **__: (state, detected))
            steps.append(tracker.step(StereoFrame(*images, DT * k, DT * k + right_later_s)))
    return steps


def test_only_what_is_seen_three_times_in_a_row_is_tracked():
    nothing: Pair = (None, None)
    status = [t.status for t in tracks([both(), both(), nothing, both(), (both()[0], None), both(), both(), both()])]
    assert status[:-1] == [Status.SEARCHING] * 7
    assert status[-1] == Status.TRACKING


def test_a_single_wild_pair_is_not_taken():
    """15 cm farther for one frame; 2 px more of disparity than there is room for."""
    wild = [both()] * 20 + [both(P - [0.15, 0, 0])] + [both()] * 3
    results = tracks(wild)
    assert [t.status for t in results[19:22]] == [Status.TRACKING, Status.COASTING, Status.TRACKING]
    assert np.linalg.norm([t.position - P for t in results[19:]], axis=1).max() < 0.002


def test_eyes_at_different_stamps_see_a_moving_object_where_it_is_at_their_mean():
    """At 0.2 m/s aside, 20 ms between the eyes would be 4 mm and 29 mm too near or too far."""
    v = 0.2 * LOOKING[:, 0]
    later = 0.02  # along the baseline
    start = P - 0.5 * 30 * DT * v
    shapes: list[Pair] = [
        (seen(LEFT, start + DT * k * v), seen(RIGHT, start + (DT * k + later) * v)) for k in range(30)
    ]
    last = tracks(shapes, right_later_s=later)[-1]
    assert np.linalg.norm(last.position - (start + last.stamp_s * v)) < 0.001


def test_what_errs_alike_in_every_frame_does_not_average_out():
    """Most of an outline's error stays as long as the object does: ten seconds at rest leave at least half of one
    frame's variance of the place and all of that of the radius."""
    last = steps([both()] * 200)[-1]
    ratio = np.diag(last.track.cov)[:3] / np.diag(last.observation.cov_root)
    assert ((ratio > 0.5) & (ratio < 1)).all()
    assert last.track.radius_var_m2 == last.observation.radius_var_m2


def test_a_size_that_changes_is_followed():
    shapes = [both()] * 100 + [both(radius_m=1.1 * RADIUS_M)] * 100
    assert abs(tracks(shapes)[-1].radius_m / RADIUS_M - 1.1) < 0.01


def test_what_is_found_elsewhere_was_lost_and_is_confirmed_anew():
    """5 cm aside, where the search finds it in the frame in which it is not seen where it was predicted."""
    rng = np.random.default_rng(3)
    steps = []
    tracker = Tracker(TrackerParams(), RIG, rng)
    for k in range(14):
        pair = both(P if k < 8 else P + 0.05 * LOOKING[:, 0])
        detected = tuple(outline and ImageDetection(outline, outline.box_px, 1.0) for outline in pair)
        followed = (None, None) if k == 8 else detected
        images = rng.integers(0, 256, (2, CAMERA.height, CAMERA.width, 3), dtype=np.uint8)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(tracker, "_follow", lambda state, *_, followed=followed, **__: (state, followed))
            patch.setattr(tracker, "_acquire", lambda state, *_, detected=detected, **__: (state, detected))
            steps.append(tracker.step(StereoFrame(*images, DT * k, DT * k)))
    status = [step.track.status for step in steps]
    assert status[4:] == [*[Status.TRACKING] * 4, Status.LOST, Status.SEARCHING, *[Status.TRACKING] * 4]
    smoothed = [step.track for step in smoothed_steps(TrackerParams().kalman, steps)]
    assert [track.status for track in smoothed] == status
    assert max(np.linalg.norm(track.position - (P + 0.05 * LOOKING[:, 0])) for track in smoothed[10:]) < 0.002


NOTHING: Pair = (None, None)


def statuses(shapes: list[Pair], **params: float) -> list[Status]:
    return [track.status for track in tracks(shapes, TrackerParams(**params))]  # type: ignore[arg-type]


def test_what_was_seen_just_often_enough_is_an_object_that_may_hide():
    results = statuses([both()] * 3 + [NOTHING] * 12)
    hidden = results.count(Status.COASTING)
    assert hidden in (9, 10)  # half a second
    assert results[2 : 4 + hidden] == [Status.TRACKING, *[Status.COASTING] * hidden, Status.LOST]
    assert statuses([both()] * 2, confirm_frames=1) == [Status.TRACKING] * 2


def frames(n: int, is_turning: bool = False) -> list[StereoFrame]:
    """Frames of noise from a fixed rig, or from a head whose joint turns by 0.02 rad from one to the next."""
    rng = np.random.default_rng(3)
    pairs = [rng.integers(0, 256, (2, CAMERA.height, CAMERA.width, 3), dtype=np.uint8) for _ in range(n)]
    joints = [np.array([0.02 * k]) if is_turning else None for k in range(n)]
    return [StereoFrame(*pairs[k], DT * k, DT * k, joints[k], joints[k]) for k in range(n)]


def given(tracker: Tracker, patch: pytest.MonkeyPatch, pair: Pair, cameras: tuple[CameraState, ...] = ()) -> None:
    """Let the tracker's search and its following find these outlines, with these states of its cameras."""
    detected = tuple(outline and ImageDetection(outline, outline.box_px, 1.0) for outline in pair)

    def find(state: TrackerState, *_: object, **__: object) -> tuple[TrackerState, object]:
        return state._replace(cameras=cameras or state.cameras), detected

    patch.setattr(tracker, "_follow", find)
    patch.setattr(tracker, "_acquire", find)


def test_a_frame_that_shows_nothing_does_not_break_a_confirmation(monkeypatch):
    """Detections in a blank frame are no observations."""
    tracker = Tracker(TrackerParams(), RIG, np.random.default_rng(3))
    results = []
    given(tracker, monkeypatch, both())
    for k, frame in enumerate(frames(12)):
        dark = np.zeros_like(frame.left)
        results.append(tracker.step(replace(frame, left=dark) if k in (2, 5) else frame))
    status = [step.track.status for step in results]
    assert status[:6] == [*[Status.SEARCHING] * 3, Status.TRACKING, Status.TRACKING, Status.COASTING]
    assert [step.observation is None for step in results] == [k in (2, 5) for k in range(12)]
    assert [len(step.detections) for step in results[4:7]] == [2, 0, 2]


CENTER = np.array([0.1, 0.2, 0.05])
"""Of a head that turns about the vertical axis."""


def turned(joints: Array | None) -> tuple[Array, Array]:
    angle = 0.0 if joints is None else float(joints[0])
    about = cv2.Rodrigues(np.array([0.0, 0.0, angle]))[0]
    to_center = transform(translation=CENTER) @ transform(about) @ transform(translation=-CENTER)
    return to_center @ LEFT.T_root_camera, to_center @ RIGHT.T_root_camera


HEAD = StereoRig(CAMERA, CAMERA, turned)


def test_joints_of_an_unknown_delay_make_what_a_turning_head_sees_uncertain():
    """Where a resting thing seems to be goes with the head: ω × (p - c) times the delay's standard deviation."""
    film = frames(2, is_turning=True)
    results = {}
    for std_s in (0.0, 0.02):
        tracker = Tracker(TrackerParams(stamp_error_s=std_s), HEAD, np.random.default_rng(3))
        for frame in film:
            view = HEAD.view_of(frame)
            with pytest.MonkeyPatch.context() as patch:
                given(tracker, patch, (seen(view.left, P), seen(view.right, P)))
                results[std_s] = tracker.step(frame).observation
    exact = results[0.0]
    late = results[0.02]
    off_m = 0.02 * np.cross([0.0, 0.0, 0.02 / DT], P - CENTER)
    for more in (late.cov_root - exact.cov_root, late.correlated_cov_root - exact.correlated_cov_root):
        np.testing.assert_allclose(more, np.outer(off_m, off_m), atol=0.03 * off_m @ off_m)


def test_a_rotation_of_the_cameras_shifts_the_object_across_their_line_of_sight():
    """By δ × a, where a is the object from the middle between the cameras and δ the rotation's error."""
    off = np.array([0.3, -0.2, 0.5])
    axes = np.eye(3)
    eyes = [View(CAMERA, transform(translation=off) @ eye.T_root_camera) for eye in (LEFT, RIGHT)]
    rig = StereoRig(CAMERA, CAMERA, lambda _: (eyes[0].T_root_camera, eyes[1].T_root_camera))
    covs = []
    for std_rad in (0.0, 0.01):
        tracker = Tracker(TrackerParams(), rig, np.random.default_rng(3))
        for frame in frames(4):
            poses = CameraPoses(rig.view_of(frame), rotation_std_rad=std_rad)
            with pytest.MonkeyPatch.context() as patch:
                given(tracker, patch, (seen(eyes[0], P + off), seen(eyes[1], P + off)))
                patch.setattr(tracker._poses, "step", lambda _, poses=poses: poses)
                track = tracker.step(frame).track
        covs.append(track.cov[:3, :3])
    shifts = 0.01 * np.cross(axes, P)
    np.testing.assert_allclose(covs[1] - covs[0], shifts.T @ shifts, atol=1e-9)


def test_a_derivative_that_is_not_modelled_is_zero():
    """Filter of order 2: acceleration and jerk are 0."""
    track = tracks([both()] * 6, TrackerParams(kalman=KalmanParams.of_order(2)))[-1]
    assert np.linalg.eigvalsh(track.cov[:6, :6]).min() > 0
    assert (np.diag(track.cov, -3)[:3] > 0).all()  # of position and velocity
    for unknown in (track.cov[6:], track.cov[:, 6:], track.mean[2:]):
        assert not unknown.any()

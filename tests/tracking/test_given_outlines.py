"""What the tracker makes of outlines that are given: exact, one-sided, jumping, of odd shape, at different stamps."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import Camera, StereoRig, StereoView, View
from pps_vision.geometry.se3 import rotation_to, transform
from pps_vision.types import Array, Detection2D, Status, StereoFrame, Track3D
from tracking import kalman
from tracking.acquisition import Candidate
from tracking.appearance import ColorModel
from tracking.camera_pose import CameraPoses
from tracking.camera_tracker import CameraState, CameraTracker
from tracking.image_tracker import ImageDetection
from tracking.kalman import KalmanParams
from tracking.optical_flow import Flow2D
from tracking.outline import Outline
from tracking.smoother import smoothed_steps
from tracking.stereo import Association, StereoParams, camera_frames
from tracking.tracker import (
    Tracker,
    TrackerParams,
    TrackerState,
    TrackerStep,
    _enlarged,
    _whole_box,
    _with_radius,
)

Pair = tuple[Outline | None, Outline | None]

CAMERA = Camera(64, 48, 220.0, 220.0, 31.5, 23.5)
LOOKING = rotation_to([-1.0, 0.0, 0.0])  # level, the root frame's x pointing backward
LEFT, RIGHT = (View(CAMERA, transform(LOOKING, 0.034 * sign * LOOKING[:, 0])) for sign in (-1, 1))
RIG = StereoRig(CAMERA, CAMERA, lambda _: (LEFT.T_root_camera, RIGHT.T_root_camera))
P, RADIUS_M, DT = np.array([-0.5, 0.0, 0.0]), 0.02, 0.05
STD_PX, RADIUS_VAR = 0.05, (0.05 / 220) ** 2


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
    """The tracker's steps where detection, by search and by following, gives these outlines whatever the images."""
    rng = np.random.default_rng(3)
    tracker = Tracker(params or TrackerParams(), RIG, rng)
    steps = []
    for k, pair in enumerate(shapes):
        detected = tuple(one and ImageDetection(one, one.box_px, 1.0) for one in pair)
        images = rng.integers(0, 256, (2, CAMERA.height, CAMERA.width, 3), dtype=np.uint8)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(tracker, "_follow", lambda state, *_, detected=detected, **__: (state, detected))
            patch.setattr(tracker, "_acquire", lambda state, *_, detected=detected, **__: (state, detected))
            steps.append(tracker.step(StereoFrame(*images, DT * k, DT * k + right_later_s)))
    return steps


def test_only_what_is_seen_three_times_in_a_row_is_tracked() -> None:
    nothing: Pair = (None, None)
    status = [t.status for t in tracks([both(), both(), nothing, both(), (both()[0], None), both(), both(), both()])]
    assert status[:-1] == [Status.SEARCHING] * 7
    assert status[-1] == Status.TRACKING


def test_a_single_wild_pair_is_not_taken() -> None:
    """15 cm farther for one frame; 2 px more of disparity than there is room for."""
    wild = [both()] * 20 + [both(P - [0.15, 0, 0])] + [both()] * 3
    found = tracks(wild)
    assert [t.status for t in found[19:22]] == [Status.TRACKING, Status.COASTING, Status.TRACKING]
    assert np.linalg.norm([t.position - P for t in found[19:]], axis=1).max() < 0.002


def test_eyes_at_different_stamps_see_a_moving_object_where_it_is_at_their_mean() -> None:
    """At 0.2 m/s aside, 20 ms between the eyes would be 4 mm and 29 mm too near or too far."""
    v, later = 0.2 * LOOKING[:, 0], 0.02  # along the baseline
    start = P - 0.5 * 30 * DT * v
    shapes: list[Pair] = [
        (seen(LEFT, start + DT * k * v), seen(RIGHT, start + (DT * k + later) * v)) for k in range(30)
    ]
    last = tracks(shapes, right_later_s=later)[-1]
    assert np.linalg.norm(last.position - (start + last.stamp_s * v)) < 0.001


def test_what_errs_alike_in_every_frame_does_not_average_out() -> None:
    """Most of an outline's error stays as long as the object does: ten seconds at rest leave at least half of one
    frame's variance of the place and all of that of the radius."""
    last = steps([both()] * 200)[-1]
    assert last.observation is not None
    ratio = np.diag(last.track.cov)[:3] / np.diag(last.observation.cov_root)
    assert ((ratio > 0.5) & (ratio < 1)).all()
    assert last.track.radius_var_m2 == last.observation.radius_var_m2


def test_a_size_that_changes_is_followed() -> None:
    shapes = [both()] * 100 + [both(radius_m=1.1 * RADIUS_M)] * 100
    assert abs(tracks(shapes)[-1].radius_m / RADIUS_M - 1.1) < 0.01


def test_a_place_that_turns_out_to_be_empty_is_background_and_no_object(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the right eye follows is the place of something that has left."""
    rng, absorbed = np.random.default_rng(3), []
    tracker = Tracker(TrackerParams(), RIG, rng)
    detected = tuple(one and ImageDetection(one, one.box_px, 1.0) for one in both())
    monkeypatch.setattr(CameraTracker, "set_from", lambda self, camera, found: absorbed.append((self.name, found)))
    monkeypatch.setattr(tracker, "_acquire", lambda state, *_, **__: (state, detected))
    status = []
    for k in range(9):
        cameras = tuple(CameraState(ghost_score=1.0 * (k == 6 and eye == 1)) for eye in (0, 1))
        follow = lambda state, *_, cameras=cameras, **__: (state._replace(cameras=cameras), detected)  # noqa: E731
        monkeypatch.setattr(tracker, "_follow", follow)
        images = rng.integers(0, 256, (2, CAMERA.height, CAMERA.width, 3), dtype=np.uint8)
        status.append(tracker.step(StereoFrame(*images, DT * k, DT * k)).track.status)
    assert status[2:6] == [Status.TRACKING] * 4
    assert status[6:] == [Status.LOST, *[Status.SEARCHING] * 2]  # it is to be confirmed anew, by three frames
    assert absorbed == [("left", detected[0]), ("right", detected[1])]


def test_what_is_found_elsewhere_was_lost_and_is_confirmed_anew() -> None:
    """5 cm aside, where the search finds it in the frame in which it is not seen where it was predicted."""
    rng, steps = np.random.default_rng(3), []
    tracker = Tracker(TrackerParams(), RIG, rng)
    for k in range(14):
        here = both(P if k < 8 else P + 0.05 * LOOKING[:, 0])
        detected = tuple(one and ImageDetection(one, one.box_px, 1.0) for one in here)
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


def test_what_was_seen_just_often_enough_is_an_object_that_may_hide() -> None:
    found = statuses([both()] * 3 + [NOTHING] * 12)
    hidden = found.count(Status.COASTING)
    assert hidden in (9, 10)  # half a second
    assert found[2 : 4 + hidden] == [Status.TRACKING, *[Status.COASTING] * hidden, Status.LOST]
    assert statuses([both()] * 2, confirm_frames=1) == [Status.TRACKING] * 2


def frames(n: int, is_turning: bool = False) -> list[StereoFrame]:
    """Frames of noise from a fixed rig, or from a head whose joint turns by 0.02 rad from one to the next."""
    rng = np.random.default_rng(3)
    pairs = [rng.integers(0, 256, (2, CAMERA.height, CAMERA.width, 3), dtype=np.uint8) for _ in range(n)]
    joints = [np.array([0.02 * k]) if is_turning else None for k in range(n)]
    return [StereoFrame(*pairs[k], DT * k, DT * k, joints[k], joints[k]) for k in range(n)]


def given(tracker: Tracker, patch: pytest.MonkeyPatch, pair: Pair, cameras: tuple[CameraState, ...] = ()) -> None:
    """Let the tracker's search and its following find these outlines, with these states of its cameras."""
    detected = tuple(one and ImageDetection(one, one.box_px, 1.0) for one in pair)

    def find(state: TrackerState, *_: object, **__: object) -> tuple[TrackerState, object]:
        return state._replace(cameras=cameras or state.cameras), detected

    patch.setattr(tracker, "_follow", find)
    patch.setattr(tracker, "_acquire", find)


def test_a_frame_that_shows_nothing_does_not_break_a_confirmation(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither is what is found in it an observation."""
    tracker, found = Tracker(TrackerParams(), RIG, np.random.default_rng(3)), []
    given(tracker, monkeypatch, both())
    for k, frame in enumerate(frames(12)):
        dark = np.zeros_like(frame.left)
        found.append(tracker.step(replace(frame, left=dark) if k in (2, 5) else frame))
    status = [step.track.status for step in found]
    assert status[:6] == [*[Status.SEARCHING] * 3, Status.TRACKING, Status.TRACKING, Status.COASTING]
    assert [step.observation is None for step in found] == [k in (2, 5) for k in range(12)]
    assert [len(step.detections) for step in found[4:7]] == [2, 0, 2]


CENTER = np.array([0.1, 0.2, 0.05])
"""Of a head that turns about the vertical axis."""


def turned(joints: Array | None) -> tuple[Array, Array]:
    angle = 0.0 if joints is None else float(joints[0])
    about = cv2.Rodrigues(np.array([0.0, 0.0, angle]))[0]
    to_center = transform(translation=CENTER) @ transform(about) @ transform(translation=-CENTER)
    return to_center @ LEFT.T_root_camera, to_center @ RIGHT.T_root_camera


HEAD = StereoRig(CAMERA, CAMERA, turned)


def test_joints_of_an_unknown_delay_make_what_a_turning_head_sees_uncertain() -> None:
    """Where a resting thing seems to be goes with the head: ω × (p - c) times the delay's standard deviation."""
    film, found = frames(2, is_turning=True), {}
    for std_s in (0.0, 0.02):
        tracker = Tracker(TrackerParams(stamp_error_s=std_s), HEAD, np.random.default_rng(3))
        for frame in film:
            view = HEAD.view_of(frame)
            with pytest.MonkeyPatch.context() as patch:
                given(tracker, patch, (seen(view.left, P), seen(view.right, P)))
                found[std_s] = tracker.step(frame).observation
    exact, late = found[0.0], found[0.02]
    assert exact is not None
    assert late is not None
    off_m = 0.02 * np.cross([0.0, 0.0, 0.02 / DT], P - CENTER)
    for more in (late.cov_root - exact.cov_root, late.correlated_cov_root - exact.correlated_cov_root):
        np.testing.assert_allclose(more, np.outer(off_m, off_m), atol=0.03 * off_m @ off_m)


def test_a_rotation_of_the_cameras_shifts_the_object_across_their_line_of_sight() -> None:
    """By δ × a, where a is the object from the middle between the cameras and δ the rotation's error."""
    off, axes = np.array([0.3, -0.2, 0.5]), np.eye(3)
    eyes = [View(CAMERA, transform(translation=off) @ eye.T_root_camera) for eye in (LEFT, RIGHT)]
    rig, covs = StereoRig(CAMERA, CAMERA, lambda _: (eyes[0].T_root_camera, eyes[1].T_root_camera)), []
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


def test_a_derivative_that_is_not_modelled_is_zero() -> None:
    """Of a filter of order 2: acceleration and jerk are 0."""
    track = tracks([both()] * 6, TrackerParams(kalman=KalmanParams.of_order(2)))[-1]
    assert np.linalg.eigvalsh(track.cov[:6, :6]).min() > 0
    assert (np.diag(track.cov, -3)[:3] > 0).all()  # of position and velocity
    for unknown in (track.cov[6:], track.cov[:, 6:], track.mean[2:]):
        assert not unknown.any()


def test_the_radius_is_the_mean_of_all_at_first_then_of_about_thirty() -> None:
    """After thirty frames of another size the old one has a share of about 1/e, (29/30)³⁰."""
    state = TrackerState(Association.untrained(StereoParams(), 64), KalmanParams())
    of = steps([both()])[0].observation
    assert of is not None
    radii = [0.020, 0.026, 0.023, 0.031]
    for k, radius_m in enumerate(radii + [0.025] * 26 + [0.030] * 30):
        before = state
        state = _with_radius(state._replace(hits=k + 1), replace(of, radius_m=radius_m, radius_var_m2=1e-6 * k))
        if k < 30:
            mean = np.mean((radii + [0.025] * 26)[: k + 1])
            assert state.radius_m == pytest.approx(mean)
        assert state.radius_var_m2 == 1e-6 * k
    assert before.radius_m < state.radius_m
    assert (0.030 - state.radius_m) / (0.030 - mean) == pytest.approx(np.exp(30 * np.log(29 / 30)), rel=1e-3)


def test_the_calibration_that_has_learned_from_a_pair_places_it() -> None:
    """But for the first, grown from a motion region, from which nothing is learned."""
    tracker, eyes = Tracker(TrackerParams(), RIG, np.random.default_rng(3)), StereoView(LEFT, RIGHT)
    left, right = both()
    assert left is not None
    assert right is not None
    lower = replace(right, center_px=right.center_px + np.array([0.0, 1.5]))
    for k, frame in enumerate(frames(8)):
        with pytest.MonkeyPatch.context() as patch:
            given(tracker, patch, (left, lower))
            observation = tracker.step(frame).observation
        assert tracker.state.association.pairs == k
        expected = tracker.state.association.observe(eyes, left, lower, DT * k)
        assert observation is not None
        assert expected is not None
        assert np.array_equal(observation.cov_root, expected.cov_root)


def test_what_is_found_elsewhere_at_once_was_lost_and_an_unconfirmed_object_was_never_there() -> None:
    """Right after the third frame; and what was seen twice, and turns out to be an empty place."""
    for n, empty, status in ((3, False, Status.LOST), (2, True, Status.SEARCHING), (3, True, Status.LOST)):
        tracker = Tracker(TrackerParams(), RIG, np.random.default_rng(3))
        for k, frame in enumerate(frames(n + 1)):
            with pytest.MonkeyPatch.context() as patch:
                cameras = tuple(CameraState(ghost_score=1.0 * (empty and k == n)) for _ in range(2))
                given(tracker, patch, both(), cameras)
                if k == n and not empty:
                    patch.setattr(tracker, "_follow", lambda state, *_, **__: (state, NOTHING))
                last = tracker.step(frame).track
        assert last.status == status


def test_what_something_passes_is_not_searched_elsewhere() -> None:
    """As long as the two touch, which either eye may tell, the other may hide it."""
    for touched, searched in (((0, 0), 2), ((0, 3), 0), ((1, 0), 0)):
        tracker, counts = Tracker(TrackerParams(), RIG, np.random.default_rng(3)), []
        for k, frame in enumerate(frames(6)):
            with pytest.MonkeyPatch.context() as patch:
                target = tracker._cameras[0].image_tracker.start(frame.left, (20, 15, 18, 18))
                cameras = tuple(CameraState(replace(target, touched=n)) for n in touched)
                given(tracker, patch, both() if k < 4 else NOTHING, cameras)
                if k >= 4:
                    patch.setattr(
                        tracker, "_acquire", lambda state, *_, counts=counts: counts.append(1) or (state, NOTHING)
                    )
                tracker.step(frame)
        assert len(counts) == searched


def test_its_colours_are_known_from_the_frame_that_confirms_it_on() -> None:
    tracker, known = Tracker(TrackerParams(), RIG, np.random.default_rng(3)), []
    for frame in frames(5):
        with pytest.MonkeyPatch.context() as patch:
            targets = [one.image_tracker.start(frame.left, (20, 15, 18, 18)) for one in tracker._cameras]
            given(tracker, patch, both(), tuple(map(CameraState, targets)))
            tracker.step(frame)
        known.append((tracker.appearance, tuple(target.model for target in targets)))
    assert [appearance is None for appearance, _ in known] == [True, True, False, False, False]
    assert all(appearance is not None and appearance[0] is known[2][1][0] for appearance, _ in known[2:])
    assert known[4][0] is not None
    assert known[4][0][1] is known[2][1][1]


def test_where_an_eye_sees_the_object_beside_its_track_is_learned_from_pairs_only() -> None:
    """The left outline is 0.5 px below; when the left eye alone sees it, 5 px to the side of that."""
    tracker, offsets = Tracker(TrackerParams(), RIG, np.random.default_rng(3)), []
    left, right = both()
    assert left is not None
    lower = replace(left, center_px=left.center_px + np.array([0.0, 0.5]))
    aside = replace(left, center_px=left.center_px + np.array([5.0, 0.5]))
    for k, frame in enumerate(frames(7)):
        with pytest.MonkeyPatch.context() as patch:
            given(tracker, patch, (lower, right) if k < 6 else (aside, None))
            patch.setattr(tracker, "_acquire", tracker._acquire if k < 6 else lambda state, *_: (state, NOTHING))
            tracker.step(frame)
        offsets.append(tracker.state.cameras[0].offset_px)
    assert offsets[5] == pytest.approx((0.0, 0.25), abs=0.1)  # half of the 0.5 px: the track lies between both
    assert offsets[6] == offsets[5]


def of_area(
    area_px: float, box_px: tuple[float, float, float, float], center_px: tuple[float, float]
) -> ImageDetection:
    one = Outline(np.array(center_px), 0.01 * np.eye(2), 0.05, 1e-6, box_px, area_px, False)
    return ImageDetection(one, box_px, 1.0)


@pytest.mark.parametrize(
    ("box", "whole"),
    [
        ((0, 50, 10, 30), (-20, 50, 30, 30)),
        ((310, 50, 10, 30), (310, 50, 30, 30)),
        ((50, 0, 30, 10), (50, -20, 30, 30)),
        ((50, 230, 30, 10), (50, 230, 30, 30)),
        ((-1, -2, 12, 30), (-19, -2, 30, 30)),
    ],
)
def test_what_the_images_border_cuts_is_taken_to_be_as_long_as_wide(
    box: tuple[int, ...], whole: tuple[int, ...]
) -> None:
    """It goes on beyond the border that cuts it."""
    assert _whole_box(of_area(300.0, box, (5.0, 5.0)).outline) == whole  # type: ignore[arg-type]


def test_what_was_seen_in_reduced_images_is_told_in_pixels_of_the_images() -> None:
    """Three times: pixel 5 is of the pixels 15, 16 and 17."""
    one = Detection2D(0.0, "left", np.array([5.0, 2.0]), np.diag([0.5, 2.0]), 0.9, 0.05, (4.0, 1.0, 3.0, 2.0))
    step = steps([both()])[0]
    assert step.observation is not None
    told = _enlarged(replace(step, detections=(one,), observation=replace(step.observation, residual_px=0.2)), 3)
    (found,) = told.detections
    np.testing.assert_allclose(found.center_px, [16.0, 7.0])
    np.testing.assert_allclose(found.cov_px, np.diag([4.5, 18.0]))
    assert found.box_px == (12.0, 3.0, 9.0, 6.0)
    assert told.observation is not None
    assert told.observation.residual_px == pytest.approx(0.6)
    assert _enlarged(replace(step, observation=None), 3).observation is None


def test_the_search_for_a_lost_object_takes_only_what_looks_and_moves_like_it() -> None:
    tracker, eyes = Tracker(TrackerParams(), RIG, np.random.default_rng(3)), StereoView(LEFT, RIGHT)
    for frame in frames(5):
        with pytest.MonkeyPatch.context() as patch:
            given(tracker, patch, both())
            tracker.step(frame)
    first, other = ColorModel(np.eye(110)[3], np.eye(110)[100]), ColorModel(np.eye(110)[50], np.eye(110)[100])
    target = replace(tracker._cameras[0].image_tracker.start(frame.left, (20, 15, 18, 18)), model=first)
    state = tracker.state._replace(cameras=(CameraState(target), CameraState(target)))
    assert state.belief is not None
    later = kalman.predict(state.kalman, state.belief, 5 * DT)

    def passes(outlines: Pair, models: tuple[ColorModel, ColorModel] = (first, first)) -> bool:
        return tracker._passes_gate(state, later, eyes, outlines, 5 * DT, models)  # type: ignore[arg-type]

    assert passes(both())
    assert not passes(both(), (first, other))
    assert not passes(both(radius_m=1.5 * RADIUS_M))
    assert not passes(both(P - [0.3, 0.0, 0.0]))
    left, right = both()
    assert not passes((left, right and replace(right, center_px=right.center_px + np.array([0.0, 15.0]))))
    assert tracker._passes_gate(state, None, eyes, both(radius_m=0.1), 5 * DT, (other, other))  # type: ignore[arg-type]


def found_by(tracker: Tracker, patch: pytest.MonkeyPatch, pair: tuple[Candidate, Candidate] | None) -> list[Array]:
    """Let the search find this pair; the colours of places that are forgotten as background are listed."""
    forgotten = list[Array]()
    patch.setattr(tracker._acquisition, "step", lambda *_: pair)
    for one in tracker._cameras:
        patch.setattr(one.background, "invalidate", lambda _image, _view, mask, _box: forgotten.append(mask))
    return forgotten


@pytest.mark.parametrize("by_color", [(True, True), (True, False)])
def test_the_particles_of_what_was_found_go_on_as_its_flow_says(
    by_color: tuple[bool, bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 40 px/s that is 2.4 px in the 60 ms from one left image to the next; without flow they rest.

    What colours do not tell fills as much of its box as it did, and is followed by the background, of which then
    nothing is forgotten.
    """
    tracker, model = Tracker(TrackerParams(), RIG, np.random.default_rng(3)), ColorModel(np.eye(110)[3], np.eye(110)[9])
    flow = Flow2D(np.zeros(2), np.eye(2), np.array([24.0, 20.0]), np.array([20.0, 23.0]), LEFT, 0.1)
    outlines = both()
    pair = tuple(
        Candidate(one, model, 1.0, seen_flow, is_color, np.ones((4, 4), bool), (20, 15, 24, 19))
        for one, seen_flow, is_color in zip(outlines, (flow, None), by_color, strict=True)
        if one is not None
    )
    forgotten = found_by(tracker, monkeypatch, pair)  # type: ignore[arg-type]
    images = frames(2)
    before = tracker.state._replace(
        stamps_s=(1.0, 1.01), cameras=(CameraState(ghost_score=0.2), CameraState(ghost_score=0.2))
    )
    later = replace(images[1], stamp_left_s=1.06, stamp_right_s=1.12)
    view = StereoView(LEFT, RIGHT)
    after, detections = tracker._acquire(before, camera_frames(later, view), view, 1.09)
    is_told = all(by_color)
    for state, one, outline, shift in zip(after.cameras, detections, outlines, ([2.4, -1.8], [0.0, 0.0]), strict=True):
        target = state.target
        assert target is not None
        assert one is not None
        assert one.outline is outline
        assert target.model is model
        moved = target.particles.current[:, :2] - target.particles.previous[:, :2]
        np.testing.assert_allclose(moved, np.broadcast_to(shift, moved.shape), atol=1e-9)
        assert (state.by_background, state.ghost_score) == (not is_told, 0.0)
        if not is_told:
            assert target.fill == pytest.approx(254 / 18**2)
    assert len(forgotten) == (2 if is_told else 0)
    assert after.search_result == pair


def test_of_what_the_border_cuts_the_whole_is_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A box of 8 x 18 px at the left border shows part of one of 18 x 18 px, of which it covers the share it had."""
    tracker, model = Tracker(TrackerParams(), RIG, np.random.default_rng(3)), ColorModel(np.eye(110)[3], np.eye(110)[9])
    view, (whole, _) = StereoView(LEFT, RIGHT), both()
    assert whole is not None
    cut = replace(whole, box_px=(0.0, 10.0, 8.0, 18.0), area_px=100.0, is_partial=True)
    one, other = (Candidate(o, model, 1.0, None, True, np.ones((4, 4), bool), (20, 15, 24, 19)) for o in (cut, whole))
    found_by(tracker, monkeypatch, (one, other))
    after, _ = tracker._acquire(tracker.state, camera_frames(frames(1)[0], view), view, 0.0)
    target = after.cameras[0].target
    assert target is not None
    assert target.size == pytest.approx(18.0)
    assert target.fill == pytest.approx(100 / (8 * 18))
    assert target.particles.current[:, 0].mean() == pytest.approx(-1.5, abs=0.3)  # the middle of columns -10 to 7


def test_a_search_that_finds_nothing_or_another_thing_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    tracker, view = Tracker(TrackerParams(), RIG, np.random.default_rng(3)), StereoView(LEFT, RIGHT)
    model, cameras = ColorModel(np.eye(110)[3], np.eye(110)[9]), camera_frames(frames(1)[0], view)
    given_pair = tuple(
        Candidate(one, model, 1.0, None, True, np.ones((4, 4), bool), (20, 15, 24, 19)) for one in both() if one
    )
    for pair, is_open in ((None, True), (given_pair, False)):
        found_by(tracker, monkeypatch, pair)  # type: ignore[arg-type]
        monkeypatch.setattr(tracker, "_passes_gate", lambda *_, is_open=is_open: is_open)
        after, detections = tracker._acquire(tracker.state, cameras, view, 0.0)
        assert after is tracker.state
        assert detections == NOTHING

"""The tracker with given outlines: exact, one-sided, jumping, of odd shape, at different stamps."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import Camera, StereoRig, View
from pps_vision.geometry.se3 import rotation_to, transform
from pps_vision.types import Array, Status, StereoFrame, Track3D
from tracking.camera_pose import CameraPoses
from tracking.image_tracker import ImageDetection
from tracking.outline import Outline
from tracking.smoother import smoothed_steps
from tracking.stereo import StereoParams
from tracking.tracker import Tracker, TrackerParams, TrackerStep

Pair = tuple[Outline | None, Outline | None]
NOTHING: Pair = (None, None)

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


def tracks(shapes: list[Pair], params: TrackerParams | None = None) -> list[Track3D]:
    return [step.track for step in steps(shapes, params)]


def statuses(shapes: list[Pair], **params: float) -> list[Status]:
    return [track.status for track in tracks(shapes, TrackerParams(**params))]


def steps(
    shapes: list[Pair],
    params: TrackerParams | None = None,
    rig: StereoRig = RIG,
    followed: dict[int, Pair] | None = None,
    joints: list[Array] | None = None,
    poses: CameraPoses | None = None,
    dark: tuple[int, ...] = (),
) -> list[TrackerStep]:
    """Tracker steps for which search and image tracker return these outlines in frames of noise.

    `followed`: other outlines of the image tracker, by frame; `poses` replace the estimated ones; the left image of
    `dark` frames shows nothing.
    """
    rng = np.random.default_rng(3)
    tracker = Tracker(params or TrackerParams(), rig, rng)
    steps = []
    for k, pair in enumerate(shapes):
        left, right = rng.integers(0, 256, (2, CAMERA.height, CAMERA.width, 3), dtype=np.uint8)
        q = joints and joints[k]
        frame = StereoFrame(0 * left if k in dark else left, right, DT * k, DT * k, q, q)
        with pytest.MonkeyPatch.context() as patch:
            acquired = None if None in pair else (lambda track: track, pair, (None, None))
            patch.setattr(tracker, "_acquire", lambda *_, result=acquired: result)
            patch.setattr(tracker, "_passes_gate", lambda *_: True)
            outlines = (followed or {}).get(k, pair)
            detected = tuple(outline and ImageDetection(outline, outline.box_px, 1.0) for outline in outlines)
            patch.setattr(tracker, "_follow", lambda track, *_, result=detected: (track, result, None))
            if poses:
                patch.setattr(tracker._poses, "step", lambda _: poses)
            steps.append(tracker.step(frame))
    return steps


def test_only_what_is_seen_three_times_in_a_row_is_tracked():
    """And may then hide for half a second."""
    status = statuses([both(), both(), NOTHING, both(), (both()[0], None), both(), both(), both()])
    assert status == [Status.SEARCHING] * 7 + [Status.TRACKING]
    results = statuses([both()] * 3 + [NOTHING] * 12)
    hidden = results.count(Status.COASTING)
    assert hidden in (9, 10)
    assert results[2 : 4 + hidden] == [Status.TRACKING, *[Status.COASTING] * hidden, Status.LOST]
    assert statuses([both()] * 2, confirm_frames=1) == [Status.TRACKING] * 2


def test_a_single_wild_pair_is_not_taken():
    """15 cm farther for one frame; 2 px more of disparity than there is room for."""
    wild = [both()] * 20 + [both(P - [0.15, 0, 0])] + [both()] * 3
    results = tracks(wild)
    assert [t.status for t in results[19:22]] == [Status.TRACKING, Status.COASTING, Status.TRACKING]
    assert np.linalg.norm([t.position - P for t in results[19:]], axis=1).max() < 0.002


def test_what_errs_alike_in_every_frame_does_not_average_out():
    """Most of an outline's error stays as long as the object does: ten seconds at rest leave at least half of one
    frame's variance of the place and all of that of the radius."""
    last = steps([both()] * 200)[-1]
    ratio = np.diag(last.track.cov)[:3] / np.diag(last.observation.cov_root)
    assert ((ratio > 0.5) & (ratio < 1)).all()
    assert last.track.radius_var_m2 == last.observation.radius_var_m2


def test_what_is_found_elsewhere_was_lost_and_is_confirmed_anew():
    """5 cm aside, where the search finds it in the frame in which it is not seen where it was predicted."""
    aside = P + 0.05 * LOOKING[:, 0]
    taken = steps([both()] * 8 + [both(aside)] * 6, followed={8: NOTHING})
    status = [step.track.status for step in taken]
    assert status[4:] == [*[Status.TRACKING] * 4, Status.LOST, Status.SEARCHING, *[Status.TRACKING] * 4]
    smoothed = [step.track for step in smoothed_steps(TrackerParams().kalman, taken)]
    assert [track.status for track in smoothed] == status
    assert max(np.linalg.norm(track.position - aside) for track in smoothed[10:]) < 0.002


def test_a_frame_that_shows_nothing_does_not_break_a_confirmation():
    """Detections in a blank frame are no observations."""
    results = steps([both()] * 12, dark=(2, 5))
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
    """Where a resting thing seems to be goes with the head: ω × (p - c) times the delay's standard deviation; of the
    variance four fifths stay from image to image."""
    joints = [np.array([0.02 * k]) for k in range(2)]
    views = [HEAD.view(q) for q in joints]
    shapes = [(seen(view.left, P), seen(view.right, P)) for view in views]
    exact, late = (
        steps(shapes, TrackerParams(stamp_error_s=std_s), rig=HEAD, joints=joints)[-1].observation
        for std_s in (0.0, 0.02)
    )
    off_m = 0.02 * np.cross([0.0, 0.0, 0.02 / DT], P - CENTER)
    correlated = late.correlated_cov_root - exact.correlated_cov_root
    for more, share in ((late.cov_root - exact.cov_root, 1.0), (correlated, 0.8)):
        np.testing.assert_allclose(more, share * np.outer(off_m, off_m), atol=0.03 * off_m @ off_m)


AHEAD = rotation_to([-0.6, 0.5, 0.4])
MIDPOINT = np.array([0.3, -0.2, 0.5])
ASIDE = MIDPOINT + AHEAD @ np.array([0.05, -0.04, 0.5])
"""Off all axes, those of the root frame and those of the cameras."""


def oblique(turn: Array, about: Array | None = None) -> tuple[View, View]:
    """Both cameras that look ahead, turned by a rotation vector (3,) about a point (3,), or about their midpoint."""
    center = MIDPOINT if about is None else about
    R = cv2.Rodrigues(turn)[0]
    T = transform(R, center - R @ center)
    left, right = (View(CAMERA, T @ transform(AHEAD, MIDPOINT + x * AHEAD[:, 0])) for x in (-0.034, 0.034))
    return left, right


def pair_of(eyes: tuple[View, View], shifts_px: Array) -> Pair:
    """Outlines of a ball at `ASIDE`, shifted by (2, 2) px."""
    left, right = (seen(eye, ASIDE) for eye in eyes)
    return tuple(replace(o, center_px=o.center_px + px) for o, px in zip((left, right), shifts_px, strict=True))


@pytest.mark.parametrize("error", ["pose", "pointing", "calibration"])
def test_the_covariance_off_the_axes_is_that_of_sampled_errors(error, rng):
    """Cameras turned from their stated pose; a turning head whose joints lag; pixels that the calibration misplaces:
    the position's covariance entry by entry, within five standard errors.  Outlines are exact, and what the stated
    covariance has without the error is subtracted."""
    n = 300
    std = {"pose": 4e-3, "pointing": 0.01, "calibration": 2e-3}[error]
    turn = 0.4 * np.array([0.3, -0.5, 0.8])  # rad/s
    still = oblique(np.zeros(3))

    def head(joints: Array | None) -> tuple[Array, Array]:
        left, right = still if joints is None else oblique(float(joints[0]) * turn, CENTER)
        return left.T_root_camera, right.T_root_camera

    def tracked(stated: float, off: Array) -> TrackerStep:
        """With the error `off` and its `stated` standard deviation."""
        rig = StereoRig(CAMERA, CAMERA, head)
        params = TrackerParams(stereo=StereoParams(1e-6, 100.0), stamp_error_s=0.0)
        if error == "pose":
            poses = CameraPoses(rig.view(None), rotation_std_rad=stated)
            return steps([pair_of(oblique(off[:3]), np.zeros((2, 2)))] * 3, params, rig, poses=poses)[-1]
        if error == "pointing":
            late = [oblique((k * DT + off[0]) * turn, CENTER) for k in range(2)]
            params = replace(params, stamp_error_s=stated)
            joints = [np.array([k * DT]) for k in range(2)]
            return steps([pair_of(eyes, np.zeros((2, 2))) for eyes in late], params, rig, joints=joints)[-1]
        params = replace(params, stereo=StereoParams(stated, 100.0))
        return steps([pair_of(still, CAMERA.width * off.reshape(2, 2))], params, rig)[-1]

    def position(step: TrackerStep) -> Array:
        return step.track.position if error == "pose" else step.observation.p_root

    def cov(step: TrackerStep) -> Array:
        return step.track.cov[:3, :3] if error == "pose" else step.observation.cov_root

    analytic = cov(tracked(std, np.zeros(4))) - cov(tracked(1e-6, np.zeros(4)))
    sampled = np.cov([position(tracked(std, std * rng.standard_normal(4))) for _ in range(n)], rowvar=False)
    variance = np.diag(analytic)
    standard_error = np.sqrt((np.outer(variance, variance) + analytic**2) / (n - 1))
    assert (np.abs(analytic) > 3 * standard_error).all()  # every entry is tested
    np.testing.assert_array_less(np.abs(sampled - analytic), 5 * standard_error)

"""Calibration and outline errors estimated from pairs, and the covariance of objects that are not balls."""

import itertools
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from ranges import check_range
from scipy.spatial.transform import Rotation

from pps_vision.geometry.camera import Camera, StereoRig, StereoView, View
from pps_vision.geometry.se3 import transform
from pps_vision.types import Array, Observation3D
from tracking.outline import Coverage, Optics, Outline, outline
from tracking.stereo import Association, StereoParams, shift_cov
from tracking.tracker import TrackerParams

CAMERA = Camera(320, 240, 400.0, 400.0, 159.5, 119.5)
VIEW = StereoRig.fixed(CAMERA, CAMERA, transform(translation=(0.068, 0.0, 0.0))).view()
EYES = VIEW.left, VIEW.right
STD_PX = 0.03
SHAPE = Outline(np.array([160.0, 120.0]), STD_PX**2 * np.eye(2), 0.05, 1e-9, (150.0, 110.0, 20.0, 20.0), 314.0, False)
SEEN = Observation3D(0.0, np.array([0.034, 0.0, 0.4]), 1e-8 * np.eye(3), 0.03, 1e-8, 0.0)


@pytest.mark.parametrize("wrong_px", [0.0, 0.2])
def test_only_what_the_outlines_do_not_explain_is_the_calibrations(wrong_px, rng):
    """Four coordinates with noise (and a constant error) leave one degree of freedom: the residual is a quarter of
    its square's root."""
    association = Association.untrained(StereoParams(), 320)
    learned = []
    for k in range(400):
        off = STD_PX * rng.standard_normal() + wrong_px
        association = association.learned(VIEW, replace(SEEN, residual_px=0.5 * abs(off)), SHAPE, SHAPE)
        if k >= 20:
            learned.append(association.error_px**2)
    assert np.mean(learned) == pytest.approx(wrong_px**2, rel=0.25, abs=0.3 * STD_PX**2)


def test_what_is_hidden_differently_from_either_eye_says_nothing_of_the_calibration(rng):
    """Half a ball in one eye, its centre 5 px off, after the pair was seen whole for a while: the doubt stays small."""
    association = Association.untrained(StereoParams(), 320)
    for _ in range(60):
        residual_px = 0.5 * abs(STD_PX * rng.standard_normal())
        association = association.learned(VIEW, replace(SEEN, residual_px=residual_px), SHAPE, SHAPE)
    half = replace(SHAPE, is_partial=True)
    after = association.learned(VIEW, replace(SEEN, residual_px=2.5), half, SHAPE)
    assert after.error_px == association.error_px < 2 * STD_PX


def test_a_visible_edge_that_was_fitted_tells_the_calibrations_error(rng):
    """A ball that a hand holds from the start: its edge errs by 0.3 px."""
    cov_px = 0.3**2 * np.eye(2)
    edge = replace(SHAPE, cov_px=cov_px, is_partial=True, is_edge=True)
    association = Association.untrained(StereoParams(), 320)
    for _ in range(60):
        residual_px = 0.5 * abs(0.3 * rng.standard_normal())
        association = association.learned(VIEW, replace(SEEN, residual_px=residual_px), edge, edge)
    assert association.error_px < 0.3
    half = replace(edge, is_edge=False)
    untrained = Association.untrained(StereoParams(), 320)
    assert untrained.learned(VIEW, SEEN, half, half).error_px == untrained.error_px > 2.0


P = np.array([0.12, 0.08, 0.4])
RADIUS_M = 0.02


def exact_outline(eye: View, angular_var: float = 1e-9, **changes: Any) -> Outline:
    """The ball's exact outline at P."""
    radius = float(np.arcsin(RADIUS_M / np.linalg.norm(P - eye.center)))
    exact = replace(SHAPE, center_px=eye.project(P), angular_radius_rad=radius, angular_radius_var=angular_var)
    return replace(exact, **changes)


@pytest.mark.parametrize("angular_var", [1e-12, 1e-5], ids=["distance decides", "size decides"])
def test_covariance_and_radius_variance_are_what_sampling_finds(angular_var, rng):
    """Outlines that err as stated, and a calibration error with its prior variance.  The distance's error of the
    radius is common to both eyes; the eyes' independent errors are halved and stated as one eye's."""
    n = 1500
    calibration_px = 0.2
    left = exact_outline(VIEW.left, angular_var)
    right = exact_outline(VIEW.right, angular_var, cov_px=STD_PX**2 * np.array([[1.0, 0.5], [0.5, 4.0]]))
    params = StereoParams(unknown_error=calibration_px / 320, gate_sigma=100.0)
    stated = Association.untrained(params, 320).observe(VIEW, left, right, 0.0)

    def drawn(eye: Outline) -> Outline:
        center = rng.multivariate_normal(eye.center_px, eye.cov_px + calibration_px**2 * np.eye(2))
        radius = eye.angular_radius_rad + np.sqrt(angular_var) * rng.standard_normal()
        return replace(eye, center_px=center, angular_radius_rad=radius)

    samples = np.empty((n, 4))
    for k in range(n):
        observation = Association.untrained(params, 320).observe(VIEW, drawn(left), drawn(right), 0.0)
        samples[k] = *observation.p_root, observation.radius_m
    sampled = np.cov(samples.T)
    variance = np.diag(stated.cov_root)
    standard_error = np.sqrt((np.outer(variance, variance) + stated.cov_root**2) / (n - 1))
    np.testing.assert_array_less(np.abs(sampled[:3, :3] - stated.cov_root), 5 * standard_error)
    eyes = 1 if angular_var < 1e-9 else 2
    assert eyes * sampled[3, 3] == pytest.approx(stated.radius_var_m2, rel=5 * np.sqrt(2 / n))


def test_why_two_outlines_are_no_pair_is_said():
    """The epipolar gate is 3.5 σ of 0.8 % of 320 px, times √2: 12.7 px; its square narrows by a twentieth with every
    pair that agrees.  The object is 6 baselines away, and by default may be 0.7 to 300."""
    left = exact_outline(VIEW.left)
    right = exact_outline(VIEW.right)
    association = Association.untrained(StereoParams(), 320)

    def refusal(association: Association, up_px: float = 0.0, larger: float = 1.0) -> str | None:
        changed = replace(
            right,
            center_px=right.center_px + np.array([0, up_px]),
            angular_radius_rad=larger * right.angular_radius_rad,
        )
        reason = association.refusal(VIEW, left, changed)
        assert (association.observe(VIEW, left, changed, 0.0) is None) == (reason is not None)
        return reason

    agreed = association
    for gate_px in 3.5 * 2.56 * np.sqrt(2) * 0.95 ** (0.5 * np.arange(30)):
        assert refusal(agreed, up_px=0.98 * gate_px) is None
        assert refusal(agreed, up_px=1.02 * gate_px) == "epipolar gate"
        agreed = agreed.learned(VIEW, replace(SEEN, p_root=P, residual_px=0.0), left, right)
    assert refusal(association, larger=1.5) is None
    assert refusal(association, larger=2.0) == refusal(association, larger=0.5) == "size"
    beyond = replace(right, center_px=left.center_px + np.array([20.0, 0.0]))  # the lines of sight diverge
    assert association.refusal(VIEW, left, beyond) == "point behind the cameras"
    assert refusal(Association.untrained(StereoParams(farthest=5.0), 320)) == "distance"
    for distance_m, refused in ((19.0, False), (22.0, True)):
        point = np.array([0.0, 0.0, distance_m])
        outlines = [replace(SHAPE, center_px=eye.project(point)) for eye in (VIEW.left, VIEW.right)]
        assert (association.refusal(VIEW, *outlines) == "distance") == refused
    for _ in range(100):
        association = association.learned(VIEW, replace(SEEN, p_root=P, residual_px=0.01), left, right)
    assert refusal(association, up_px=0.1) is None
    assert refusal(association, up_px=1.0) == "epipolar gate"


@pytest.mark.parametrize(
    ("name", "refused", "taken"),
    [
        ("unknown_error", (0.0, np.nan), (1e-6,)),
        ("gate_sigma", (0.0, np.nan), (0.1,)),
        ("farthest", (-0.1, 0.0), (1.0,)),
    ],
)
def test_parameters_outside_their_range_are_refused(name, refused, taken):
    check_range(StereoParams, name, refused, taken, lambda _: "expected positive numbers")


def test_differences_of_both_outlines_that_stay_are_a_correlated_error(rng):
    """Radii of both eyes that differ by 0.5 px for the same distance, always or by chance: only what stays is
    correlated."""
    correlated = {}
    for stays in (True, False):
        association = Association.untrained(StereoParams(), 320)
        shares = []
        for k in range(60):
            more_px = 0.5 if stays else 0.5 * rng.standard_normal()
            left, right = (replace(exact_outline(eye), cov_px=STD_PX**2 * np.eye(2)) for eye in EYES)
            left = replace(left, angular_radius_rad=left.angular_radius_rad + more_px / CAMERA.focal_px)
            association = association.learned(VIEW, replace(SEEN, p_root=P), left, right)
            observation = association.observe(VIEW, left, right, 0.0)
            if k >= 20:
                shares.append(np.trace(observation.correlated_cov_root) / np.trace(observation.cov_root))
        correlated[stays] = np.mean(shares)
    assert correlated[True] > 0.9
    assert correlated[False] < 0.4


def test_only_what_is_less_round_than_a_ball_with_a_rough_edge_may_be_flat():
    """Up to 4 px² over the squared radius, here of 12 px."""
    association = Association.untrained(StereoParams(unknown_error=1e-9), 320)
    ball = [replace(exact_outline(eye), angular_radius_rad=12 / CAMERA.focal_px) for eye in (VIEW.left, VIEW.right)]
    stated = []
    for non_circularity in (0.0, 4.0 / 12**2, 4.0 / 12**2 + 0.01):
        outlines = (replace(outline, non_circularity=non_circularity) for outline in ball)
        stated.append(np.trace(association.observe(VIEW, *outlines, 0.0).cov_root))
    assert stated[0] == pytest.approx(stated[1], rel=1e-6)
    assert stated[2] > 1.01 * stated[1]


def rough(eye: View, center: Array, radius_m: float, edge: Array, optics: Optics) -> Outline:
    """The outline of a ball whose edge is off by `edge` (n,) px, evenly spaced around it."""
    u, v = eye.project(center)
    x0 = int(u) - 40
    y0 = int(v) - 40
    x, y = np.meshgrid(np.arange(x0, x0 + 80) - u, np.arange(y0, y0 + 80) - v)
    around = np.interp(np.arctan2(y, x), np.linspace(-np.pi, np.pi, len(edge) + 1), np.append(edge, edge[0]))
    radius = CAMERA.focal_px * radius_m / center[2] + around
    alpha = np.clip(radius - np.hypot(x, y) + 0.5, 0, 1).astype(np.float32)
    return outline(Coverage(alpha, np.zeros_like(alpha), (x0, y0, x0 + 80, y0 + 80)), optics)


def test_what_two_outlines_differ_by_is_what_their_centres_are_off(rng):
    """Edges of 28 px radius that err by 1.5 px independently every 9 px, or equally in both eyes; the outlines do not
    state it.  The position's covariance is right, except for the depth where both eyes have the same error."""
    optics = Optics(CAMERA)
    center = np.array([0.034, 0.0, 0.5])
    for alike in (False, True):
        association = Association.untrained(StereoParams(), 320)
        squared = []
        for k in range(120):
            edge_px = 1.5 * rng.standard_normal(20)
            left = rough(VIEW.left, center, 0.035, edge_px, optics)
            right = rough(VIEW.right, center, 0.035, edge_px if alike else 1.5 * rng.standard_normal(20), optics)
            for _ in range(2):
                observation = association.observe(VIEW, left, right, 0.0)
                association = association.learned(VIEW, observation, left, right)
            if k >= 20:
                squared.append((observation.p_root - center) ** 2 / np.diag(observation.cov_root))
        across, _, depth = np.mean(squared, axis=0)
        assert 0.4 < across < 1.6
        assert alike or 0.5 < depth < 1.6


CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
CIRCLE = np.array([[np.cos(a), np.sin(a), 0.0] for a in np.linspace(0, 2 * np.pi, 40, endpoint=False)])
BODIES = {
    "cube": CORNERS,
    "plate": CORNERS * [1.0, 1.0, 0.1],
    "rod": CORNERS * [0.4, 0.4, 1.0],
    "cone": np.vstack([CIRCLE - [0, 0, 0.5], [[0, 0, 1.5]]]),  # the centre is a quarter of its height above the base
    "tetrahedron": CORNERS[[0, 3, 5, 6]],
}
"""Corners of convex bodies about their centres of mass."""


def silhouette(eye: View, corners: Array, optics: Optics) -> Outline:
    """The outline of a convex body, its pixels' shares sampled 8 times finer."""
    px = eye.project(corners)
    x0, y0 = (px.min(axis=0) - 3).astype(int)
    x1, y1 = (px.max(axis=0) + 4).astype(int)
    fine = np.zeros((8 * (y1 - y0), 8 * (x1 - x0)), np.uint8)
    cv2.fillConvexPoly(fine, cv2.convexHull(np.rint((px - [x0, y0] + 0.5) * 8 - 0.5).astype(np.int32)), (1,))
    alpha = fine.reshape(y1 - y0, 8, x1 - x0, 8).mean(axis=(1, 3), dtype=np.float32)
    return outline(Coverage(alpha, np.zeros_like(alpha), (x0, y0, x1, y1)), optics)


def test_the_centre_of_a_body_that_is_no_ball_is_off_as_far_as_is_stated(rng):
    """Bodies of about 3 cm radius in any orientation, seen without any other error: mean square of the distance from
    their centres to the observed points and mean of its stated variance, along the line of sight and across it.
    The eyes are a metre beside the root frame's origin."""
    optics = Optics(CAMERA)
    association = Association.untrained(StereoParams(1e-9, 1e9), 320)
    view = StereoView(*(View(CAMERA, transform(translation=(1.0, 0.0, 0.0)) @ eye.T_root_camera) for eye in EYES))
    squared, stated = [], []
    for corners in BODIES.values():
        size_m = 0.04 / np.linalg.norm(corners, axis=1).mean()
        for rotation in Rotation.random(20, random_state=int(rng.integers(2**31))):
            away = np.array([0.0, 0.0, 0.4]) + 0.03 * rng.standard_normal(3)
            center = view.midpoint + away
            corners_root = center + size_m * rotation.apply(corners)
            outlines = [silhouette(eye, corners_root, optics) for eye in (view.left, view.right)]
            observation = association.observe(view, *outlines, 0.0)
            off = observation.p_root - center
            ahead = away / np.linalg.norm(away)
            variance = float(ahead @ observation.cov_root @ ahead)
            squared.append((float(off @ ahead) ** 2, off @ off - float(off @ ahead) ** 2))
            stated.append((variance, np.trace(observation.cov_root) - variance))
    ratio = np.mean(squared, axis=0) / np.mean(stated, axis=0)
    assert (ratio > 0.4).all()
    assert (ratio < 2.5).all()


def test_the_error_of_a_body_that_is_no_ball_changes_with_its_aspect(rng):
    """Bodies in any orientation that pass by: mean square of the change of their error, and that stated by
    `TrackerParams.aspect_rad`."""
    optics = Optics(CAMERA)
    turn_rad = 0.05
    squared = []
    stated = []
    for corners in BODIES.values():
        size_m = 0.04 / np.linalg.norm(corners, axis=1).mean()
        for rotation in Rotation.random(20, random_state=int(rng.integers(2**31))):
            association = Association.untrained(StereoParams(), 320)
            errors = []
            for k in range(5):
                center = np.array([0.034, 0.0, 0.4]) + 0.4 * turn_rad * k * np.array([0.8, 0.6, 0.0])
                outlines = [silhouette(eye, center + size_m * rotation.apply(corners), optics) for eye in EYES]
                observation = association.observe(VIEW, *outlines, 0.0)
                association = association.learned(VIEW, observation, *outlines)
                errors.append(observation.p_root - center)
            squared.append(np.square(errors[-1] - errors[1]).sum() / (3 * turn_rad) ** 2)
            stated.append(np.trace(observation.correlated_cov_root) / TrackerParams().aspect_rad ** 2)
    assert 0.4 < np.mean(squared) / np.mean(stated) < 2.5


def test_the_centre_shifts_as_its_correlated_error_grows():
    """The visible part changes from a standard deviation of 1 cm to one of 4 cm along the line of sight."""
    before, after = (replace(SEEN, correlated_cov_root=np.diag([0.0, 0.0, std**2])) for std in (0.01, 0.04))
    np.testing.assert_allclose(shift_cov(before, after), np.diag([0.0, 0.0, 0.03**2]), atol=1e-12)
    assert not shift_cov(after, before).any()
    assert not shift_cov(before, before).any()

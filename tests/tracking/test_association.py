"""What pairs tell of the calibration: nothing where residuals are the outlines' own noise, its error where not."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pps_vision.geometry.camera import Camera, StereoRig, View
from pps_vision.geometry.se3 import transform
from pps_vision.types import Observation3D
from tracking.association import Association, AssociationParams
from tracking.outline import Outline

STD_PX = 0.03
SHAPE = Outline(
    np.array([160.0, 120.0]), STD_PX**2 * np.eye(2), 0.05, 1e-9, (150.0, 110.0, 20.0, 20.0), 314.0, False, 0.0
)
SEEN = Observation3D(0.0, np.array([-0.4, 0.0, 0.3]), 1e-8 * np.eye(3), 0.03, 1e-8, 0.0)


@pytest.mark.parametrize("wrong_px", [0.0, 0.2])
def test_only_what_the_outlines_do_not_explain_is_the_calibrations(wrong_px: float, rng: np.random.Generator) -> None:
    """Four coordinates with noise (and a constant error) leave one degree of freedom: the residual is a quarter of
    its square's root."""
    association = Association(AssociationParams(), 320)
    learned = []
    for k in range(400):
        off = STD_PX * rng.standard_normal() + wrong_px
        association.learn(replace(SEEN, residual_px=0.5 * abs(off)), SHAPE, SHAPE)
        if k >= 20:
            learned.append(association.error_px**2)
    assert np.mean(learned) == pytest.approx(wrong_px**2, rel=0.25, abs=0.3 * STD_PX**2)


def test_what_is_hidden_differently_from_either_eye_says_nothing_of_the_calibration(rng: np.random.Generator) -> None:
    """Half a ball in one eye, its centre 5 px off, after the pair was seen whole for a while: the doubt stays small."""
    association, half = Association(AssociationParams(), 320), replace(SHAPE, departure=0.1)
    for _ in range(60):
        association.learn(replace(SEEN, residual_px=0.5 * abs(STD_PX * rng.standard_normal())), SHAPE, SHAPE)
    before = association.error_px
    for _ in range(10):
        association.learn(replace(SEEN, residual_px=2.5), half, SHAPE)
    assert association.error_px == before < 2 * STD_PX


def test_what_is_never_whole_tells_of_the_calibration_at_first(rng: np.random.Generator) -> None:
    association, odd = Association(AssociationParams(), 320), replace(SHAPE, departure=0.1)
    for _ in range(60):
        association.learn(replace(SEEN, residual_px=0.5 * abs(STD_PX * rng.standard_normal())), odd, odd)
    assert association.error_px < 10 * STD_PX < AssociationParams().unknown_error * 320


CAMERA = Camera(320, 240, 400.0, 400.0, 159.5, 119.5)
VIEW = StereoRig.fixed(CAMERA, CAMERA, transform(translation=(0.068, 0.0, 0.0))).view()
P, RADIUS_M = np.array([0.12, 0.08, 0.4]), 0.02


def seen(eye: View, angular_var: float = 1e-9, **changes: Any) -> Outline:
    """The ball at P as it is seen without error."""
    radius = float(np.arcsin(RADIUS_M / np.linalg.norm(P - eye.center)))
    exact = replace(SHAPE, center_px=eye.project(P), angular_radius_rad=radius, angular_radius_var=angular_var)
    return replace(exact, **changes)


@pytest.mark.parametrize("hidden_eye", ["left", "right"])
def test_who_sees_less_of_it_is_believed_less(hidden_eye: str) -> None:
    """Two parallel eyes see a ball of 2 cm at 0.4 m; of its 40 px a strip of 0.8 is hidden from one, whose outline is
    then 0.4 px smaller in radius and its centre 0.4 px off: some mm in depth, a tenth of that claimed."""
    hidden_px, claimed, off_px = 0.4, [], {}
    for px in (0.0, hidden_px):
        eyes = {"left": seen(VIEW.left), "right": seen(VIEW.right)}
        part = eyes[hidden_eye]
        eyes[hidden_eye] = replace(
            part,
            center_px=part.center_px + np.array([px, 0.0]),
            angular_radius_rad=part.angular_radius_rad - px / 400.0,
        )
        found = Association(AssociationParams(unknown_error=1e-4), 320).observe(VIEW, eyes["left"], eyes["right"], 0.0)
        assert found is not None
        error, depth_std = abs(found.p_root[2] - 0.4), np.sqrt(found.cov_root[2, 2])
        claimed.append(depth_std)
        assert error < 3 * depth_std
        assert (error > 0.002) == (px > 0)
        for name, eye in (("left", VIEW.left), ("right", VIEW.right)):
            J = eye.project_jacobian(found.p_root)
            off_px[name] = np.sqrt((J @ found.cov_root @ J.T)[0, 0])
    assert claimed[1] > 5 * claimed[0]
    whole_eye = "right" if hidden_eye == "left" else "left"
    assert off_px[whole_eye] < 2 * STD_PX < 0.8 * hidden_px < off_px[hidden_eye]


def test_another_shape_of_almost_that_size_is_not_hidden() -> None:
    """A toy whose outlines differ by 5 % of their radius in the two eyes, as they may."""
    toy = seen(VIEW.left, departure=0.1), seen(VIEW.right, departure=0.1)
    smaller = replace(toy[1], angular_radius_rad=0.95 * toy[1].angular_radius_rad)
    found, exact = (Association(AssociationParams(), 320).observe(VIEW, toy[0], one, 0.0) for one in (smaller, toy[1]))
    assert found is not None
    assert exact is not None
    np.testing.assert_allclose(found.cov_root, exact.cov_root, rtol=1e-9)
    ball = Association(AssociationParams(), 320).observe(VIEW, seen(VIEW.left), seen(VIEW.right), 0.0)
    assert ball is not None
    assert np.sqrt(exact.radius_var_m2 - ball.radius_var_m2) == pytest.approx(0.05 * RADIUS_M, rel=0.05)


@pytest.mark.parametrize("angular_var", [1e-12, 1e-5], ids=["distance decides", "size decides"])
def test_covariance_and_radius_variance_are_what_sampling_finds(angular_var: float, rng: np.random.Generator) -> None:
    """Outlines that err as stated, and a calibration that errs by what is believed of it before anything is known.
    A radius that errs with the distance errs alike in both eyes; what they err by each on its own is halved, and
    stated as that of one of them."""
    n, calibration_px = 1500, 0.2
    left, right = seen(VIEW.left, angular_var), seen(VIEW.right, angular_var)
    right = replace(right, cov_px=STD_PX**2 * np.array([[1.0, 0.5], [0.5, 4.0]]))
    params = AssociationParams(unknown_error=calibration_px / 320, gate_sigma=100.0, hidden_sigma=100.0)
    stated = Association(params, 320).observe(VIEW, left, right, 0.0)
    assert stated is not None
    found = np.empty((n, 4))
    for k in range(n):
        one, other = (
            replace(
                eye,
                center_px=rng.multivariate_normal(eye.center_px, eye.cov_px + calibration_px**2 * np.eye(2)),
                angular_radius_rad=eye.angular_radius_rad + np.sqrt(angular_var) * rng.standard_normal(),
            )
            for eye in (left, right)
        )
        observation = Association(params, 320).observe(VIEW, one, other, 0.0)
        assert observation is not None
        found[k] = *observation.p_root, observation.radius_m
    sampled, variance = np.cov(found.T), np.diag(stated.cov_root)
    standard_error = np.sqrt((np.outer(variance, variance) + stated.cov_root**2) / (n - 1))
    np.testing.assert_array_less(np.abs(sampled[:3, :3] - stated.cov_root), 5 * standard_error)
    eyes = 1 if angular_var < 1e-9 else 2
    assert eyes * sampled[3, 3] == pytest.approx(stated.radius_var_m2, rel=5 * np.sqrt(2 / n))


def test_what_cannot_be_one_thing_is_no_pair() -> None:
    """Eyes that see it one higher than the other by more than the calibration may be off, or twice as large; what is
    nearer than the eyes are apart, or too far away.  The gate narrows as pairs agree."""
    left, right = seen(VIEW.left), seen(VIEW.right)

    def pair(association: Association, up_px: float, larger: float = 1.0) -> Observation3D | None:
        other = replace(
            right,
            center_px=right.center_px + np.array([0, up_px]),
            angular_radius_rad=larger * right.angular_radius_rad,
        )
        return association.observe(VIEW, left, other, 0.0)

    association = Association(AssociationParams(), 320)
    assert pair(association, 10.0) is not None  # 3.5 σ of 0.8 % of 320 px, times √2
    assert pair(association, 16.0) is None
    assert pair(association, 0.0, larger=1.5) is not None
    assert pair(association, 0.0, larger=2.0) is None
    for _ in range(100):
        association.learn(replace(SEEN, residual_px=0.01), left, right)
    assert pair(association, 0.1) is not None
    assert pair(association, 1.0) is None
    association.forget()
    assert pair(association, 1.0) is not None
    for distance_range in ((7.0, 300.0), (0.7, 5.0)):  # it is 6 baselines away
        assert pair(Association(AssociationParams(distance_range=distance_range), 320), 0.0) is None


def test_eyes_that_look_one_after_the_other_are_brought_to_one_moment() -> None:
    left, right, shift = seen(VIEW.left), seen(VIEW.right), np.array([3.0, -1.0])
    once = Association(AssociationParams(), 320).observe(VIEW, left, right, 0.0)
    early, late = (replace(eye, center_px=eye.center_px - sign * shift) for eye, sign in ((left, 1), (right, -1)))
    moved = Association(AssociationParams(), 320).observe(VIEW, early, late, 0.0, (shift, -shift))
    assert once is not None
    assert moved is not None
    np.testing.assert_allclose(moved.p_root, once.p_root, atol=1e-9)

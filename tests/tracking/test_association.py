"""What pairs tell of the calibration: nothing where residuals are the outlines' own noise, its error where not."""

from dataclasses import replace

import numpy as np
import pytest

from pps_vision.geometry.camera import Camera, StereoRig, View
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


def test_who_sees_less_of_it_is_believed_less() -> None:
    """Two parallel eyes see a ball of 2 cm at 0.4 m; of its 40 px a strip of 0.8 is hidden from the right one, whose
    outline is then 0.4 px smaller in radius and its centre 0.4 px off: some mm in depth, a tenth of that claimed."""
    camera = Camera(320, 240, 400.0, 400.0, 159.5, 119.5)
    T_left_right = np.eye(4)
    T_left_right[0, 3] = 0.068
    view = StereoRig.fixed(camera, camera, T_left_right).view()
    p, wide, hidden = np.array([0.02, 0.01, 0.4]), 0.02, 0.4

    def seen(eye: View, hidden_px: float) -> Outline:
        distance = float(np.linalg.norm(p - eye.center))
        radius = np.arcsin(wide / distance) - hidden_px / 400.0
        return replace(SHAPE, center_px=eye.project(p) + np.array([hidden_px, 0.0]), angular_radius_rad=radius)

    claimed = {}
    for hidden_px in (0.0, hidden):
        association = Association(AssociationParams(unknown_error=1e-4), 320)
        found = association.observe(view, seen(view.left, 0.0), seen(view.right, hidden_px), 0.0)
        assert found is not None
        error, depth_std = abs(found.p_root[2] - 0.4), np.sqrt(found.cov_root[2, 2])
        claimed[hidden_px] = depth_std
        assert error < 3 * depth_std
        assert (error > 0.002) == (hidden_px > 0)
    assert claimed[hidden] > 5 * claimed[0.0]

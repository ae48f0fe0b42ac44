"""The distance from the disparity of a surface, on ray-cast scenes whose truth is where the spheres were put."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from raycast import Sphere, frame

from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.icub import home, set_gaze
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Observation3D, StereoFrame
from tracking.disparity import DisparityParams, match, parallel_patches, refine_distance
from tracking.outline import Outline

RADIUS = 0.035


def _scene(
    robot: Robot, rig: StereoRig, vergence: float, stripes: int, rng: np.random.Generator
) -> tuple[StereoFrame, Array]:
    """A ball 0.35 m before the middle between the eyes."""
    q = set_gaze(robot, home(robot), pitch=-0.2, vergence=vergence)
    view = rig.view(q)
    ahead = view.left.T_root_camera[:3, 2] + view.right.T_root_camera[:3, 2]
    p = 0.5 * (view.left.center + view.right.center) + 0.35 * ahead / np.linalg.norm(ahead)
    return frame(rig, q, [Sphere(p, RADIUS, (200.0, 170.0, 30.0), stripes)], 0.0, rng), p


def _outline(distance: float) -> Outline:
    return Outline(np.zeros(2), np.eye(2), float(np.arcsin(RADIUS / distance)), 1e-6, (0, 0, 1, 1), 1.0, False, 0.0)


@pytest.mark.parametrize("vergence", [0.0, 0.2, 0.5])
def test_a_wrong_distance_is_put_right_from_the_texture(
    robot: Robot, rig: StereoRig, vergence: float, rng: np.random.Generator
) -> None:
    seen, p = _scene(robot, rig, vergence, 25, rng)
    view = rig.view_of(seen)
    ray = p - view.left.center
    distance = float(np.linalg.norm(ray))
    for wrong in (-0.05, 0.05):
        guess = Observation3D(0.0, view.left.center + (1 + wrong) * ray, 1e-4 * np.eye(3), RADIUS, 1e-6, 0.1)
        found = refine_distance(DisparityParams(), view, seen.left, seen.right, _outline(distance), guess)
        assert found is not None
        error = float(np.linalg.norm(found.p_root - view.left.center)) - distance
        assert abs(error) < 0.15 * abs(wrong) * distance
        assert error**2 < 9 * (ray @ found.cov_root @ ray) / distance**2  # and it knows how well
        np.testing.assert_allclose(np.cross(found.p_root - view.left.center, ray), 0.0, atol=1e-12)


def test_a_smooth_ball_has_no_disparity_of_its_own(robot: Robot, rig: StereoRig, rng: np.random.Generator) -> None:
    seen, p = _scene(robot, rig, 0.2, 0, rng)
    guess = Observation3D(0.0, p, 1e-4 * np.eye(3), RADIUS, 1e-6, 0.1)
    assert refine_distance(DisparityParams(), rig.view_of(seen), seen.left, seen.right, _outline(0.35), guess) is None


@pytest.mark.parametrize("vergence", [0.0, 0.5])
def test_turned_parallel_a_point_lies_on_one_row_as_far_apart_as_its_depth_says(
    robot: Robot, rig: StereoRig, vergence: float
) -> None:
    """f·b·(1/z − 1/z₀) px, for a black bead at a depth z in patches made for z₀."""
    q = set_gaze(robot, home(robot), pitch=-0.2, vergence=vergence)
    view = rig.view(q)
    p = 0.5 * (view.left.center + view.right.center) + np.array([-0.35, 0.01, -0.07])
    for nearer in (1.0, 0.9, 1.15):
        bead = view.left.center + nearer * (p - view.left.center)
        seen = frame(rig, q, [Sphere(bead, 0.004, (0.0, 0.0, 0.0))], 0.0)
        empty = frame(rig, q, [], 0.0)
        patches, without = (parallel_patches(view, f.left, f.right, p, (30, 12)) for f in (seen, empty))
        left, right = (_middle(a, b) for a, b in ((patches.left, without.left), (patches.right, without.right)))
        expected = patches.focal_px * patches.baseline_m / patches.depth_m * (1 / nearer - 1)
        np.testing.assert_allclose(left, (30, 12), atol=0.15)
        np.testing.assert_allclose(right, (30 - expected, 12), atol=0.15)


def _middle(image: NDArray[np.uint8], empty: NDArray[np.uint8]) -> Array:
    """(x, y) of what one image shows and the other does not."""
    weight = np.abs(image.astype(float) - empty)
    v, u = np.mgrid[: weight.shape[0], : weight.shape[1]]
    return np.array([(weight * u).sum(), (weight * v).sum()]) / weight.sum()


@pytest.mark.parametrize("shift", [-3.25, 0.5, 2.0])
def test_matching_finds_a_shift_where_there_is_texture(shift: float, rng: np.random.Generator) -> None:
    left = cv2.GaussianBlur(rng.uniform(0, 255, (31, 61)), (0, 0), 1.5).astype(np.uint8)
    right = cv2.warpAffine(left, np.array([[1.0, 0.0, -shift], [0.0, 1.0, 0.0]]), (61, 31))
    noise = rng.normal(0, 2, left.shape)
    found = match(DisparityParams(), left, np.clip(right + noise, 0, 255).astype(np.uint8), 12.0)
    assert found is not None
    assert found[0] == pytest.approx(shift, abs=0.15)
    assert abs(found[0] - shift) < 3 * found[1]
    smooth = np.clip(100 + np.linspace(-20, 20, 61) + noise, 0, 255).astype(np.uint8)
    assert match(DisparityParams(), smooth, smooth, 12.0) is None  # no texture but noise
    assert match(DisparityParams(), left, right[::-1].copy(), 12.0) is None  # not the same thing
    assert match(DisparityParams(), left, right, 3.0) is None  # too small to have texture of its own

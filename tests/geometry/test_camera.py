"""Cameras against OpenCV's own projection, finite differences and round trips."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pps_vision.geometry.camera import Camera, StereoRig, View
from pps_vision.geometry.se3 import transform
from pps_vision.geometry.triangulation import triangulate
from pps_vision.robot.icub import LEFT_EYE, RIGHT_EYE
from pps_vision.types import Array, StereoFrame

PINHOLE = Camera(320, 240, 220.0, 221.0, 159.5, 119.5)
WITH_K3 = Camera(640, 480, 500.0, 505.0, 320.0, 238.0, (-0.2, 0.1, 0.001, -0.002, -0.02))
CAMERAS = pytest.mark.parametrize(
    "camera", [PINHOLE, LEFT_EYE, RIGHT_EYE, WITH_K3], ids=["pinhole", "left", "right", "k3"]
)


def points_in_view(camera: Camera, rng: np.random.Generator, n: int = 200) -> Array:
    """Points 0.1–2 m before the camera, filling the image of the pinhole model."""
    z = rng.uniform(0.1, 2.0, n)
    u = rng.uniform(0, camera.width, n)
    v = rng.uniform(0, camera.height, n)
    return np.column_stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z])


@CAMERAS
def test_project_is_opencvs(camera, rng):
    points = points_in_view(camera, rng)
    theirs, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.K, np.array(camera.distortion))
    np.testing.assert_allclose(camera.project(points), theirs[:, 0], atol=1e-9)


def test_a_moved_view_projects_as_opencv_and_its_jacobian_is_the_slope(rng):
    rotation = Rotation.random(rng=rng)
    view = View(LEFT_EYE, transform(rotation.as_matrix(), (0.1, -0.4, 0.3)))
    p_root = view.T_root_camera[:3, :3] @ [0.05, 0.04, 0.4] + view.center
    inverse_rotation = rotation.inv()
    theirs, _ = cv2.projectPoints(
        p_root[None], inverse_rotation.as_rotvec(), -inverse_rotation.apply(view.center), LEFT_EYE.K,
        np.array(LEFT_EYE.distortion),
    )  # fmt: skip
    np.testing.assert_allclose(view.project(p_root), theirs[0, 0], atol=1e-9)
    slopes = [(view.project(p_root + 1e-6 * e) - view.project(p_root - 1e-6 * e)) / 2e-6 for e in np.eye(3)]
    np.testing.assert_allclose(view.project_jacobian(p_root), np.column_stack(slopes), rtol=1e-5, atol=1e-4)
    assert view.sees(p_root)
    assert view.place == tuple(view.center)
    assert not view.sees(2 * view.center - p_root)  # behind
    ray = view.rays(view.project(p_root))
    np.testing.assert_allclose(np.cross(ray, p_root - view.center), 0.0, atol=1e-8)


@CAMERAS
def test_what_cannot_be_seen_projects_to_nan(camera):
    assert np.all(np.isnan(camera.project([[0.0, 0.0, -1.0], [0.1, 0.0, 0.0]])))
    assert np.all(np.isfinite(camera.project([0.0, 0.0, 0.5])))


@pytest.mark.parametrize(
    ("k1", "k2", "k3", "tan2"),
    [(-0.374, 0.0, 0.0, 1 / (3 * 0.374)), (0.0, -0.2, 0.0, 1.0), (0.0, 0.0, -1 / 7, 1.0), (-0.1, -0.06, -0.4 / 7, 1.0)],
)
def test_a_point_so_far_aside_that_the_lens_model_folds_back_is_not_seen(k1, k2, k3, tan2):
    """The image of a ray turns back where 1 + 3 k1 tan² + 5 k2 tan⁴ + 7 k3 tan⁶ is 0."""
    camera = Camera(320, 240, 220.0, 220.0, 159.5, 119.5, (k1, k2, 0.0, 0.0, k3))
    angles = np.deg2rad(np.linspace(0, 80, 801))
    points = np.column_stack([np.sin(angles), np.zeros(801), np.cos(angles)])
    u = camera.project(points)[:, 0]
    is_visible = np.isfinite(u)
    np.testing.assert_allclose([camera.project_linearised(*point)[0] for point in points.tolist()], u, atol=1e-9)
    assert angles[is_visible].max() == pytest.approx(np.arctan(np.sqrt(tan2)), abs=0.003)
    assert np.all(np.diff(u[is_visible]) > 0)


def test_the_mean_of_a_block_of_pixels_is_where_the_reduced_camera_has_its_pixel(rng):
    small = WITH_K3.reduced(4)
    assert (small.width, small.height) == (160, 120)
    points = points_in_view(WITH_K3, rng)
    np.testing.assert_allclose(4 * small.project(points) + 1.5, WITH_K3.project(points), atol=1e-9)  # 0, 1, 2, 3: 1.5


def test_contains_counts_pixel_areas_and_refuses_nan():
    assert PINHOLE.contains((-0.5, -0.5))
    assert PINHOLE.contains((319.5, 239.5))
    for outside in ((319.6, 100.0), (-0.6, 100.0), (100.0, 239.6), (100.0, -0.6)):
        assert not PINHOLE.contains(outside)
    assert not PINHOLE.contains((4.0, 100.0), margin_px=5.0)
    assert not PINHOLE.contains((np.nan, 100.0))


@pytest.mark.parametrize("change", [{"fx": 0.0}, {"fy": 0.0}, {"fy": np.nan}, {"width": 0}, {"height": 0}])
def test_a_camera_without_extent_or_focal_length_is_refused(change):
    arguments = {"width": 320, "height": 240, "fx": 220.0, "fy": 220.0, "cx": 160.0, "cy": 120.0} | change
    with pytest.raises(ValueError, match="expected positive numbers"):
        Camera(**arguments)


def test_a_view_sees_to_the_edge_of_the_image_or_to_a_margin():
    """The pixel is 319.25, in the outer half of the last column."""
    view = View(PINHOLE, np.eye(4))
    point = [(319.25 - 159.5) / 220.0, 0.0, 1.0]
    assert view.sees(point)
    assert not view.sees(point, margin_px=0.5)


def test_a_fixed_rig_has_the_left_camera_as_root():
    T_left_right = transform(translation=(0.068, 0.0, 0.0))
    view = StereoRig.fixed(LEFT_EYE, RIGHT_EYE, T_left_right).view()
    np.testing.assert_array_equal(view.left.T_root_camera, np.eye(4))
    np.testing.assert_allclose(view.right.project([0.068, 0.0, 0.5]), RIGHT_EYE.project([0.0, 0.0, 0.5]))


def test_each_eye_is_placed_by_the_joints_of_its_own_stamp():
    def eye_poses(joints: Array | None) -> tuple[Array, Array]:
        assert joints is not None
        return transform(translation=(joints[0], 0, 0)), transform(translation=(joints[0], 1, 0))

    rig = StereoRig(LEFT_EYE, RIGHT_EYE, eye_poses)
    image = np.zeros((240, 320, 3), np.uint8)
    view = rig.view_of(StereoFrame(image, image, 0.0, 0.01, np.array([1.0]), np.array([2.0])))
    np.testing.assert_array_equal(view.left.center, [1.0, 0.0, 0.0])
    np.testing.assert_array_equal(view.right.center, [2.0, 1.0, 0.0])
    np.testing.assert_array_equal(rig.view(np.array([3.0])).right.center, [3.0, 1.0, 0.0])


@CAMERAS
def test_a_real_camera_is_usable(camera):
    assert camera.is_usable()
    assert replace(PINHOLE, distortion=(-0.5666, 0.1991, -0.028, 0.0076, 0.1772)).is_usable()  # inverted to 0.2 px


def test_a_camera_looks_at_more_than_a_hundredth_of_a_radian():
    across = 319 / 0.0103
    down = 239 / 0.0103
    assert replace(PINHOLE, fx=across, fy=down).is_usable()
    assert not replace(PINHOLE, fx=across * 1.06, fy=down).is_usable()
    assert not replace(PINHOLE, fx=across, fy=down * 1.06).is_usable()


@pytest.mark.parametrize(
    "change",
    [
        {"fx": 1e308},
        {"fy": 1e-300},
        {"cx": 1e9},
        {"distortion": (1e9, 0.0, 0.0, 0.0, 0.0)},
        {"distortion": (0.0, 0.0, 0.0, 0.0, 1e308)},
        {"distortion": (1e200, 0.0, 0.0, 0.0, 0.0)},
        {"distortion": (-0.1892, 0.1864, 0.0435, 0.0185, -0.0796)},  # inverted to 5 px
        {"distortion": (-1.0, 0.0, 0.0, 0.0, 0.0)},  # folds back at tan² = 1/3; the corner is at tan² = 0.82
    ],
)
def test_a_camera_that_cannot_be_is_not(change):
    assert not replace(PINHOLE, **change).is_usable()


LENSES = {
    "rational": (0.1, 0.01, 0.001, 0.002, 0.006, 0.2, 0.03, 0.01),
    "thin prism": (-0.2, 0.1, 0.001, 0.002, 0.006, 0.2, 0.0, 0.0, 0.01, 0.002, -0.01, 0.003),
    "tilted": (0.1, 0.01, 0.001, 0.002, 0.006, 0.2, 0.0, 0.0, 0.01, 0.002, -0.01, 0.003, 0.05, -0.03),
    "fisheye": (0.05, -0.01, 0.003, -0.001),
    "equidistant": (0.0, 0.0, 0.0, 0.0),
}


@pytest.mark.parametrize("distortion", LENSES.values(), ids=LENSES)
def test_each_lens_projects_and_triangulates_as_opencv_projects(distortion):
    """Also from its image back to the ray, with gradients as central differences have them."""
    camera = Camera(640, 480, 400.0, 405.0, 320.0, 238.0, distortion, fisheye=len(distortion) == 4)
    points = np.random.default_rng(0).uniform((-0.5, -0.4, 0.6), (0.5, 0.4, 1.5), (100, 3))
    project = cv2.fisheye.projectPoints if camera.fisheye else cv2.projectPoints
    T_left_right = np.eye(4)
    T_left_right[0, 3] = 0.1
    pixels = [
        project((points - x).reshape(-1, 1, 3), np.zeros(3), np.zeros(3), camera.K, np.array(distortion))[0].reshape(
            -1, 2
        )
        for x in ((0, 0, 0), T_left_right[:3, 3])
    ]
    np.testing.assert_allclose(camera.project(points), pixels[0], atol=1e-9)
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    np.testing.assert_allclose(camera.bearings(pixels[0]), rays, atol=1e-9)
    assert camera.is_usable()
    view = StereoRig.fixed(camera, camera, T_left_right).view()
    for point, left_px, right_px in zip(points, *pixels, strict=True):
        found = triangulate(view, left_px, right_px, np.eye(2), np.eye(2))
        assert found is not None
        np.testing.assert_allclose(found.p_root, point, atol=1e-8)
        step = 1e-6 * np.eye(3)
        central = (camera.project(point + step) - camera.project(point - step)).T / 2e-6
        np.testing.assert_allclose(view.left.project_jacobian(point), central, atol=1e-5)


def test_a_fisheye_s_image_may_be_a_disc_of_more_than_180_degrees():
    """What lies beside or behind the camera has a bearing, and no projection."""
    camera = Camera(800, 800, 250.0, 250.0, 399.5, 399.5, (0.0, 0.0, 0.0, 0.0), fisheye=True)
    assert camera.is_usable()
    angle = np.linalg.norm([399.5, 0]) / 250
    np.testing.assert_allclose(camera.bearings([799.0, 399.5]), [np.sin(angle), 0, np.cos(angle)], atol=1e-9)
    assert np.isnan(camera.project([1.0, 0.0, -0.01])).all()


def test_a_lens_has_as_many_coefficients_as_a_model_of_opencv():
    with pytest.raises(ValueError, match=r"6 distortion coefficients: expected 5 or 8 or 12 or 14"):
        Camera(640, 480, 400.0, 400.0, 320.0, 240.0, (0.0,) * 6)
    with pytest.raises(ValueError, match="5 distortion coefficients"):
        Camera(640, 480, 400.0, 400.0, 320.0, 240.0, (0.0,) * 5, fisheye=True)

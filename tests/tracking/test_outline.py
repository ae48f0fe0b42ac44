"""Where a sphere's centre is, from its image: against the projection of the true centre."""

import cv2
import numpy as np
import pytest
from raycast import Sphere, look
from scipy.spatial.transform import Rotation

from pps_vision.geometry.camera import Camera, View
from pps_vision.geometry.se3 import transform
from pps_vision.robot.icub import LEFT_EYE
from tracking.compiled_masks import hollowness
from tracking.cones import consensus, fitted
from tracking.marker import MarkerParams, find_markers, threshold
from tracking.outline import Coverage, Optics, cover, outline
from tracking.rim import see

RED, GREEN = (210.0, 45.0, 40.0), (25.0, 200.0, 60.0)
FULL = (0, 0, LEFT_EYE.width, LEFT_EYE.height)


@pytest.fixture(scope="module")
def optics() -> Optics:
    return Optics(LEFT_EYE)


def _hard(camera: Camera, sphere: Sphere) -> np.ndarray:
    """Pixels whose own ray hits the sphere."""
    ray = sphere.center / np.linalg.norm(sphere.center)
    return camera.bearing_map @ ray > np.sqrt(1 - (sphere.radius_m / np.linalg.norm(sphere.center)) ** 2)


@pytest.mark.parametrize(("radius", "color", "rms_px"), [(0.035, RED, 0.08), (0.010, GREEN, 0.1)])
def test_center_and_size_are_sub_pixel_and_covered(
    optics: Optics, rng: np.random.Generator, radius: float, color: tuple[float, float, float], rms_px: float
) -> None:
    errors, sizes = [], []
    for _ in range(8):
        center = np.array([rng.uniform(-0.12, 0.1), rng.uniform(-0.05, 0.09), rng.uniform(0.28, 0.6)])
        sphere = Sphere(center, radius, color)
        shape = outline(cover(look(View(LEFT_EYE, np.eye(4)), [sphere], rng), _hard(LEFT_EYE, sphere), FULL), optics)
        assert shape is not None
        error = shape.center_px - LEFT_EYE.project(center)
        errors.append(error)
        sizes.append(shape.angular_radius_rad / np.arcsin(radius / np.linalg.norm(center)))
        assert np.all(np.abs(error) < 6 * np.sqrt(np.diag(shape.cov_px)) + 0.05)
        assert np.linalg.eigvalsh(shape.cov_px).min() > 0
    assert np.sqrt(np.mean(np.square(errors))) < rms_px
    assert np.mean(sizes) == pytest.approx(1, abs=0.03)


def test_stated_variances_of_lit_balls_are_those_of_their_errors(rng: np.random.Generator) -> None:
    """Balls of 5–30 px lit from above: mean squared normalised errors of centre and radius.

    Across, the stated variance is that of the errors.  Down the image half as much again is left to what light does to
    both eyes alike (`TrackerParams.light_error`), and the radius is stated half as uncertain again as it is.
    """
    camera = Camera(100, 100, 220.0, 220.0, 49.5, 49.5)
    optics, n = Optics(camera), 160
    down = np.column_stack([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # camera axes in the root frame, whose z is up
    view = View(camera, transform(down))
    squared = np.empty((n, 3))
    for k in range(n):
        angular = rng.uniform(5, 30) / camera.focal_px
        in_camera = np.array([*rng.uniform(-0.03, 0.03, 2), 0.5])
        sphere = Sphere(down @ in_camera, float(np.linalg.norm(in_camera) * np.sin(angular)), GREEN)
        image = look(view, [sphere], rng)
        mask = threshold(MarkerParams(), image) > 0
        shape = outline(cover(image, mask, (0, 0, camera.width, camera.height)), optics)
        assert shape is not None
        squared[k, :2] = (shape.center_px - camera.project(in_camera)) ** 2 / np.diag(shape.cov_px)
        squared[k, 2] = (shape.angular_radius_rad - angular) ** 2 / shape.angular_radius_var
    across, down_image, radius = squared.mean(axis=0)
    assert 0.65 < across < 1.3
    assert 1.0 < down_image < 2.3
    assert 0.25 < radius < 0.9


def test_the_share_of_a_covariance_that_pixels_cause_is_what_sampling_finds(rng: np.random.Generator) -> None:
    """Pixels that err two and two alike, in two opposite quarters of a disc's edge: entry by entry."""
    camera = Camera(60, 60, 220.0, 220.0, 29.5, 29.5)
    optics, box, n = Optics(camera), (0, 0, 60, 60), 1500
    y, x = np.mgrid[:60, :60] - 29.5
    alpha = np.clip(16.2 - np.hypot(x, y), 0, 1).astype(np.float32)
    edge = (alpha > 0) & (alpha < 1)
    variance = np.where(edge & (x * y > 0), 0.05, np.where(edge, 0.01, 0)).astype(np.float32)
    stated = outline(Coverage(alpha, variance, box), optics)
    plain = outline(Coverage(alpha, 0 * variance, box), optics)
    assert stated is not None
    assert plain is not None
    found = np.empty((n, 3))
    for k in range(n):
        noise = np.sqrt(variance) * rng.standard_normal(alpha.shape)
        shape = outline(Coverage((alpha + noise).astype(np.float32), 0 * variance, box), optics)
        assert shape is not None
        found[k] = *shape.center_px, shape.angular_radius_rad
    sampled = 2 * np.cov(found.T)  # two pixels that err alike are worth one
    bound = 5 * np.sqrt((np.outer(np.diag(sampled), np.diag(sampled)) + sampled**2) / (n - 1))
    np.testing.assert_array_less(np.abs(stated.cov_px - plain.cov_px - sampled[:2, :2]), bound[:2, :2])
    assert stated.angular_radius_var - plain.angular_radius_var == pytest.approx(sampled[2, 2], abs=bound[2, 2])
    assert abs(sampled[0, 1]) > 2 * bound[0, 1]  # or the test could not tell


def test_the_middle_of_a_cube_is_stated_to_be_off(rng: np.random.Generator) -> None:
    """Cubes in any orientation: most of the error stays for many frames and is `TrackerParams.shape_error`'s; the
    outline itself states at least a quarter of its standard deviation, and no more than all of it."""
    camera, fine = Camera(80, 80, 220.0, 220.0, 39.5, 39.5), 3
    optics = Optics(camera)
    v, u = np.mgrid[: 80 * fine, : 80 * fine]
    rays = camera.bearings((np.stack([u, v], axis=-1) + 0.5) / fine - 0.5)
    squared, stated = [], []
    for _ in range(60):
        half, center = rng.uniform(0.012, 0.03), np.array([*rng.uniform(-0.01, 0.01, 2), 0.4])
        R = Rotation.random(rng=rng).as_matrix()
        slabs = (np.array([[-half], [half]]) + R.T @ center)[:, None, None] / (rays @ R)
        hit = slabs.min(axis=0).max(axis=-1) < slabs.max(axis=0).min(axis=-1)
        alpha = hit.reshape(80, fine, 80, fine).mean(axis=(1, 3)).astype(np.float32)
        shape = outline(Coverage(alpha, 0 * alpha, (0, 0, 80, 80)), optics)
        assert shape is not None
        squared.append(np.sum((shape.center_px - camera.project(center)) ** 2))
        stated.append(np.trace(shape.cov_px))
    assert 0.25 < np.sqrt(np.mean(stated) / np.mean(squared)) < 1


def test_perspective_does_not_pull_the_center(optics: Optics) -> None:
    """Wide aside and near, the plain centroid of a sphere's image is off by over half a pixel."""
    sphere = Sphere(np.array([-0.12, 0.06, 0.2]), 0.035, RED)
    hard = _hard(LEFT_EYE, sphere)
    true = LEFT_EYE.project(sphere.center)
    rows, columns = np.nonzero(hard)
    assert np.linalg.norm([columns.mean() - true[0], rows.mean() - true[1]]) > 0.5
    shape = outline(cover(look(View(LEFT_EYE, np.eye(4)), [sphere]), hard, FULL), optics)
    assert shape is not None
    assert np.linalg.norm(shape.center_px - true) < 0.12


def test_a_small_window_is_as_good_as_the_whole_image(optics: Optics, rng: np.random.Generator) -> None:
    for center in ((0.02, 0.01, 0.4), (-0.05, 0.03, 0.45)):
        sphere = Sphere(np.array(center), 0.02, GREEN)
        image = look(View(LEFT_EYE, np.eye(4)), [sphere], rng)
        x, y = LEFT_EYE.project(sphere.center)
        (one,) = find_markers(MarkerParams(), image, optics, (float(x), float(y), 25.0))
        other = outline(cover(image, threshold(MarkerParams(), image) > 0, FULL), optics)
        assert other is not None
        np.testing.assert_allclose(one.center_px, other.center_px, atol=1e-6)
        assert (one.box_px, one.at_border) == (other.box_px, other.at_border)
        assert one.area_px == pytest.approx(other.area_px, rel=1e-6)
        assert one.angular_radius_rad == pytest.approx(other.angular_radius_rad, rel=1e-6)


def test_nothing_covered_is_none(optics: Optics) -> None:
    image = np.full((240, 320, 3), 90, np.uint8)
    assert outline(cover(image, np.zeros((240, 320), bool), FULL), optics) is None


def test_a_ball_cut_by_the_border_is_completed(optics: Optics, rng: np.random.Generator) -> None:
    center = np.array([-0.335, 0.02, 0.35])
    sphere = Sphere(center, 0.035, RED)
    true = LEFT_EYE.project(center)
    assert 0 < true[0] < 15
    shape = see(look(View(LEFT_EYE, np.eye(4)), [sphere], rng), _hard(LEFT_EYE, sphere), FULL, optics)
    assert shape is not None
    assert shape.at_border
    assert np.linalg.norm(shape.center_px - true) < 0.7
    assert shape.angular_radius_rad == pytest.approx(np.arcsin(0.035 / np.linalg.norm(center)), rel=0.03)


def test_a_ball_half_hidden_is_completed(optics: Optics, rng: np.random.Generator) -> None:
    sphere = Sphere(np.array([0.0, 0.02, 0.35]), 0.035, RED)
    true = LEFT_EYE.project(sphere.center)
    image = look(View(LEFT_EYE, np.eye(4)), [sphere], rng)
    hard = _hard(LEFT_EYE, sphere)
    whole = float(hard.sum())
    u = int(true[0]) + 4
    image[:, u:], hard[:, u:] = (60, 90, 140), False
    shape = see(image, hard, FULL, optics, whole)
    assert shape is not None
    assert np.linalg.norm(shape.center_px - true) < 0.7


@pytest.mark.parametrize("kind", ["half hidden", "cut by the border"])
def test_what_is_stated_of_a_completed_ball_is_what_it_errs_by(kind: str, rng: np.random.Generator) -> None:
    """Mean squared normalised errors of centre and radius; the straight edge that hides it pulls at both."""
    camera, radius, n = Camera(120, 120, 220.0, 220.0, 59.5, 59.5), 0.03, 40
    optics, squared = Optics(camera), np.empty((n, 2))
    for k in range(n):
        center = np.array([*rng.uniform(-0.01, 0.01, 2), 0.35]) - [0.085 * (kind == "cut by the border"), 0, 0]
        sphere = Sphere(center, radius, RED)
        image, hard = look(View(camera, np.eye(4)), [sphere], rng), _hard(camera, sphere)
        if kind == "half hidden":
            u = int(camera.project(center)[0]) + rng.integers(0, 8)
            image[:, u:], hard[:, u:] = (60, 90, 140), False
        shape = see(image, hard, (0, 0, 120, 120), optics, np.pi * (radius / 0.35 * 220) ** 2)
        assert shape is not None
        assert shape.departure == 0
        error = shape.center_px - camera.project(center)
        angle = np.arcsin(radius / np.linalg.norm(center))
        squared[k, 0] = error @ np.linalg.solve(shape.cov_px, error) / 2
        squared[k, 1] = (shape.angular_radius_rad - angle) ** 2 / shape.angular_radius_var
    of_center, of_radius = squared.mean(axis=0)
    assert 0.4 < of_center < 2.0
    assert 0.4 < of_radius < 4.0


@pytest.mark.parametrize("fingers", [(-9,), (-9, 2, 12)])
def test_a_ball_held_by_fingers_is_completed_though_it_was_never_seen_whole(
    optics: Optics, rng: np.random.Generator, fingers: tuple[int, ...]
) -> None:
    """From above, as wide as a finger, down to just past the ball's middle."""
    sphere = Sphere(np.array([0.0, 0.02, 0.35]), 0.035, RED)
    true = LEFT_EYE.project(sphere.center)
    image = look(View(LEFT_EYE, np.eye(4)), [sphere], rng)
    hard = _hard(LEFT_EYE, sphere)
    v, u = np.mgrid[:240, :320]
    for aside in fingers:
        hides = (np.abs(u - true[0] - aside) < 3.5) & (v < true[1] + 3)
        image[hides], hard[hides] = (219, 163, 133), False
    shape = see(image, hard, FULL, optics)
    assert shape is not None
    assert np.linalg.norm(np.argwhere(hard).mean(axis=0)[::-1] - true) > 1
    assert np.linalg.norm(shape.center_px - true) < 0.25
    assert shape.angular_radius_rad == pytest.approx(np.arcsin(0.035 / np.linalg.norm(sphere.center)), rel=0.02)


def test_a_square_cut_by_the_border_is_not_taken_for_a_ball(optics: Optics) -> None:
    image = np.full((240, 320, 3), (90, 80, 70), np.uint8)
    hard = np.zeros((240, 320), bool)
    hard[100:140, 0:25] = True
    image[hard] = (30, 60, 220)
    shape = see(image, hard, FULL, optics)
    assert shape is not None
    assert shape.center_px[0] < 15
    assert np.sqrt(shape.cov_px[0, 0]) > 2


@pytest.mark.parametrize("center", [(0.0, 0.02, 0.35), (-0.12, 0.06, 0.2), (0.1, -0.03, 0.6)])
def test_a_ball_anywhere_departs_from_no_disc(
    optics: Optics, rng: np.random.Generator, center: tuple[float, float, float]
) -> None:
    sphere = Sphere(np.array(center), 0.035, RED)
    shape = outline(cover(look(View(LEFT_EYE, np.eye(4)), [sphere], rng), _hard(LEFT_EYE, sphere), FULL), optics)
    assert shape is not None
    assert shape.departure < 0.006


def test_a_square_departs_from_the_disc_of_its_area(optics: Optics) -> None:
    """By four corners; of them the outermost pixel's width, where coverage is uncertain, does not count."""
    side = 41
    image = np.full((240, 320, 3), (90, 80, 70), np.uint8)
    hard = np.zeros((240, 320), bool)
    hard[90 : 90 + side, 150 : 150 + side] = True
    image[hard] = (30, 60, 220)
    shape = outline(cover(image, hard, FULL), optics)
    assert shape is not None
    v, u = (np.mgrid[:4100, :4100] + 0.5) / 100 - side / 2
    distance = np.hypot(u, v)
    low, high = (np.mean(distance > side / np.sqrt(np.pi) + edge) for edge in (1.5, 0.5))
    assert low < shape.departure < high


def test_a_thin_limb_hardly_pulls_the_center(optics: Optics) -> None:
    image = np.full((240, 320, 3), (90, 80, 70), np.uint8)
    v, u = np.mgrid[:240, :320]
    hard = np.hypot(u - 150, v - 110) < 20.2
    hard[107:114, 150:230] = True
    image[hard] = (30, 60, 220)
    shape = outline(cover(image, hard, FULL), optics)
    assert shape is not None
    assert np.nonzero(hard)[1].mean() - 150 > 10
    assert abs(shape.center_px[0] - 150) < 8
    assert abs(shape.center_px[1] - 110) < 0.5


def _no_disc(optics: Optics, hard: np.ndarray) -> None:
    """What is no disc, and not known to be hidden, is measured as it shows."""
    image = np.full((240, 320, 3), (90, 80, 70), np.uint8)
    image[hard] = (30, 60, 220)
    shape, plain = see(image, hard, FULL, optics), outline(cover(image, hard, FULL), optics)
    assert shape is not None
    assert plain is not None
    assert plain.oddness == 1
    np.testing.assert_array_equal(shape.center_px, plain.center_px)


def test_a_square_that_nothing_hides_is_not_completed(optics: Optics) -> None:
    v, u = np.mgrid[:240, :320]
    along, across = 0.9 * (u - 150) + 0.4 * (v - 110), 0.9 * (v - 110) - 0.4 * (u - 150)
    _no_disc(optics, (abs(along) < 20) & (abs(across) < 20))


def test_limbs_are_no_sign_of_something_hidden(optics: Optics) -> None:
    v, u = np.mgrid[:240, :320]
    angle, distance = np.arctan2(v - 110, u - 150), np.hypot(u - 150, v - 110)
    _no_disc(optics, (distance < 16) | ((distance < 38) & (distance * abs(np.sin(2.5 * angle)) < 8)))


def test_hollowness_is_the_share_of_the_hull_that_is_not_covered(rng: np.random.Generator) -> None:
    for _ in range(20):
        alpha = (rng.random((11, 14)) > rng.uniform(0.3, 0.9)).astype(np.float32)
        hull = cv2.convexHull(np.argwhere(alpha > 0.5)[:, ::-1].astype(np.int32))
        inside = sum(cv2.pointPolygonTest(hull, (x, y), False) >= 0 for y in range(11) for x in range(14))
        assert hollowness(alpha) == pytest.approx(1 - float(alpha.sum()) / inside, abs=1e-9)
    assert hollowness(np.zeros((3, 4), np.float32)) == 0


def test_the_cone_of_most_rays_is_found_and_fitted(rng: np.random.Generator) -> None:
    """Rays of a known cone, a third of them replaced by others."""
    angle, radius = rng.uniform(0, 2 * np.pi, 120), 0.1
    turned = np.linalg.qr(rng.standard_normal((3, 3)))[0] * [1, 1, 1]
    axis = turned[:, 2] * np.sign(turned[2, 2])
    rim = np.outer(np.cos(angle), turned[:, 0]) + np.outer(np.sin(angle), turned[:, 1])
    rays = np.cos(radius) * axis + np.sin(radius) * rim
    rays[:40] = axis + 0.07 * rim[:40] * rng.uniform(0, 1, (40, 1))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    best, agreeing = consensus(rays, 220.0, 1.0)
    assert agreeing >= 80
    cone = np.array(fitted(rays, best, 0.3, 220.0, 4))
    assert np.arccos(1 / np.linalg.norm(cone)) == pytest.approx(radius, abs=0.05 / 220)
    assert np.arccos(min(axis @ cone / np.linalg.norm(cone), 1)) < 0.05 / 220
    assert np.isnan(fitted(np.tile(axis, (20, 1)), best, 0.3, 220.0, 4)).all()  # one ray tells no cone

"""Where a sphere's centre is, from its image: against the projection of the true centre."""

import numpy as np
import pytest
from ball_scenes import Sphere, look

from pps_vision.geometry.camera import Camera, View
from pps_vision.geometry.se3 import transform
from pps_vision.robot.icub import LEFT_EYE
from tracking.marker import MarkerParams, find_markers, threshold
from tracking.outline import Coverage, Optics, cover, fit_outline, outline

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

    Across, the stated variance is that of the errors.  Down the image light from above shifts both cameras' outlines
    alike (`Association.shared_var_px2`); the radius is stated twice as uncertain as it is.
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
    assert 0.7 < across < 1.3
    assert 1.5 < down_image < 3.5
    assert 0.2 < radius < 0.6


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


def test_covariance_is_carried_through_a_lens_that_distorts(optics: Optics) -> None:
    """Far off the axis: 2 J S Jᵀ, by finite differences of the projection, beyond that of a certain outline."""
    y, x = np.mgrid[:40, :40] - 19.5
    alpha = np.clip(12 - np.hypot(x, 1.4 * y), 0, 1).astype(np.float32)
    variance = np.where((alpha > 0) & (alpha < 1), 0.05 + 0.001 * x, 0).astype(np.float32)
    left, top = 270, 10
    stated, certain = (
        outline(Coverage(alpha, v, (left, top, left + 40, top + 40)), optics) for v in (variance, 0 * variance)
    )
    assert stated is not None
    assert certain is not None
    crop = np.s_[top : top + 40, left : left + 40]
    rays = LEFT_EYE.bearing_map[crop] * LEFT_EYE.solid_angle_map[crop][..., None]
    S = np.einsum("vu,vui,vuj", variance.astype(float), rays, rays)
    direction = np.einsum("vu,vui", alpha.astype(float), rays)
    h = 1e-5 * np.linalg.norm(direction)
    J = np.array(
        [(LEFT_EYE.project(direction + d) - LEFT_EYE.project(direction - d)) / (2 * h) for d in h * np.eye(3)]
    ).T
    np.testing.assert_allclose(stated.cov_px - certain.cov_px, 2 * J @ S @ J.T, rtol=1e-4)


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
        assert (one.box_px, one.is_partial) == (other.box_px, other.is_partial)
        assert one.area_px == pytest.approx(other.area_px, rel=1e-6)
        assert one.angular_radius_rad == pytest.approx(other.angular_radius_rad, rel=1e-6)


def test_harmonics_are_those_of_the_edge() -> None:
    """Far off the axis a ball's image is an ellipse, and its edge has none.  On the axis an edge has those it was drawn
    with; a square's second moment is π/3 of a disc's."""
    wide = Camera(320, 240, 220.0, 220.0, 159.5, 119.5)
    aside = _hard(wide, Sphere(np.array([-0.14, 0.0, 0.25]), 0.03, RED))
    ball = outline(Coverage(aside.astype(np.float32), np.zeros(aside.shape, np.float32), FULL), Optics(wide))
    assert ball is not None
    assert np.abs([*ball.harmonics, ball.non_circularity]).max() < 0.006
    rows, columns = np.nonzero(aside)
    assert np.ptp(columns) > 1.1 * np.ptp(rows)
    camera = Camera(100, 100, 900.0, 900.0, 49.5, 49.5)
    y, x = np.mgrid[:100, :100] - 49.5
    angle, share = np.arctan2(y, x), np.array([0.03, -0.02, 0.01, 0.025])
    waves = np.stack([np.cos(2 * angle), np.sin(2 * angle), np.cos(3 * angle), np.sin(3 * angle)], axis=-1)
    edge = 30 * (1 + waves @ share)
    square = np.clip(30.5 - np.abs(x), 0, 1) * np.clip(30.5 - np.abs(y), 0, 1)
    waved, squared = (
        outline(Coverage(alpha.astype(np.float32), np.zeros((100, 100), np.float32), (0, 0, 100, 100)), Optics(camera))
        for alpha in (np.clip(edge - np.hypot(x, y) + 0.5, 0, 1), square)
    )
    assert waved is not None
    assert squared is not None
    np.testing.assert_allclose(waved.harmonics, share, atol=0.003)
    assert squared.non_circularity == pytest.approx(np.pi / 3 - 1, abs=0.003)


def test_nothing_covered_is_none(optics: Optics) -> None:
    image = np.full((240, 320, 3), 90, np.uint8)
    assert outline(cover(image, np.zeros((240, 320), bool), FULL), optics) is None


@pytest.mark.parametrize("kind", ["cut by the border", "half hidden"])
def test_the_covariance_of_a_part_covers_its_distance_from_the_whole(kind: str, rng: np.random.Generator) -> None:
    """Hidden up to three fifths, its size known to 3 %: mean squared normalised error of the centre."""
    camera, radius, n = Camera(120, 120, 220.0, 220.0, 59.5, 59.5), 0.03, 40
    optics, squared = Optics(camera), []
    for _ in range(n):
        center = np.array([*rng.uniform(-0.01, 0.01, 2), 0.35]) - [0.085 * (kind == "cut by the border"), 0, 0]
        sphere = Sphere(center, radius, RED)
        image, hard = look(View(camera, np.eye(4)), [sphere], rng), _hard(camera, sphere)
        if kind == "half hidden":
            u = int(camera.project(center)[0]) + rng.integers(-3, 8)
            image[:, u:], hard[:, u:] = (60, 90, 140), False
        expected_px = np.pi * (radius * (1 + 0.03 * rng.standard_normal()) / 0.35 * 220) ** 2
        shape = fit_outline(image, hard, (0, 0, 120, 120), optics, expected_px)
        assert shape is not None
        assert shape.is_partial
        error = shape.center_px - camera.project(center)
        squared.append(error @ np.linalg.solve(shape.cov_px, error) / 2)
    assert 0.2 < np.mean(squared) < 2


def test_a_disc_or_an_outline_of_the_expected_area_is_whole(optics: Optics, rng: np.random.Generator) -> None:
    sphere = Sphere(np.array([0.0, 0.02, 0.35]), 0.035, RED)
    image, hard = look(View(LEFT_EYE, np.eye(4)), [sphere], rng), _hard(LEFT_EYE, sphere)
    whole, free = (fit_outline(image, hard, FULL, optics, area) for area in (float(hard.sum()), None))
    smaller = fit_outline(image, hard, FULL, optics, 1.3 * hard.sum())
    part = hard & (np.arange(hard.shape[1]) < np.nonzero(hard)[1].mean() + 8)
    hidden = fit_outline(image, part, FULL, optics, float(hard.sum()))
    assert whole is not None
    assert free is not None
    assert smaller is not None
    assert hidden is not None
    assert (whole.is_partial, free.is_partial, smaller.is_partial, hidden.is_partial) == (False, False, False, True)
    np.testing.assert_array_equal(whole.cov_px, free.cov_px)
    assert hidden.cov_px[0, 0] > 10 * whole.cov_px[0, 0]

"""Where a sphere's centre is, from its image: against the projection of the true centre."""

from itertools import product

import cv2
import numpy as np
import pytest
from ball_scenes import Sphere, look

from pps_vision.geometry.camera import Camera, View
from pps_vision.geometry.se3 import transform
from pps_vision.robot.icub import LEFT_EYE
from pps_vision.types import Image, Mask
from tracking.marker import MarkerParams, threshold
from tracking.outline import Coverage, Optics, Outline, cover, fit_outline, fit_visible_edge, outline

RED = (210.0, 45.0, 40.0)
GREEN = (25.0, 200.0, 60.0)
FULL = (0, 0, LEFT_EYE.width, LEFT_EYE.height)


@pytest.fixture(scope="module")
def optics() -> Optics:
    return Optics(LEFT_EYE)


def _hard(camera: Camera, sphere: Sphere) -> np.ndarray:
    """Pixels whose own ray hits the sphere."""
    ray = sphere.center / np.linalg.norm(sphere.center)
    return camera.bearing_map() @ ray > np.sqrt(1 - (sphere.radius_m / np.linalg.norm(sphere.center)) ** 2)


def drawn(mask: Mask) -> Image:
    """Red before blue."""
    return np.where(mask[..., None], RED, (60.0, 90.0, 140.0)).astype(np.uint8)


def disc(x: float, y: float, radius: float) -> Mask:
    v, u = np.mgrid[:240, :320]
    return np.asarray(np.hypot(u - x, v - y) < radius)


def test_stated_variances_of_lit_balls_are_those_of_their_errors(rng):
    """Balls of 5–30 px lit from above: mean squared normalised errors of centre and radius.

    Across, the stated variance is that of the errors.  Down the image light from above shifts both cameras' outlines
    equally (`Association.shared_var_px2`); the radius's standard deviation is overestimated twofold.
    """
    camera = Camera(100, 100, 220.0, 220.0, 49.5, 49.5)
    optics = Optics(camera)
    n = 160
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
        squared[k, :2] = (shape.center_px - camera.project(in_camera)) ** 2 / np.diag(shape.cov_px)
        squared[k, 2] = (shape.angular_radius_rad - angular) ** 2 / shape.angular_radius_var
    across, down_image, radius = squared.mean(axis=0)
    assert 0.8 < across < 1.1
    assert 2.3 < down_image < 3.1
    assert 0.25 < radius < 0.37


def test_the_share_of_a_covariance_that_pixels_cause_is_what_sampling_finds(rng):
    """Pairs of pixels with a common error in two opposite quarters of a disc's edge: entry by entry."""
    camera = Camera(60, 60, 220.0, 220.0, 29.5, 29.5)
    optics = Optics(camera)
    box = (0, 0, 60, 60)
    n = 1500
    y, x = np.mgrid[:60, :60] - 29.5
    alpha = np.clip(16.2 - np.hypot(x, y), 0, 1).astype(np.float32)
    edge = (alpha > 0) & (alpha < 1)
    variance = np.where(edge & (x * y > 0), 0.05, np.where(edge, 0.01, 0)).astype(np.float32)
    stated = outline(Coverage(alpha, variance, box), optics)
    plain = outline(Coverage(alpha, 0 * variance, box), optics)
    samples = np.empty((n, 3))
    for k in range(n):
        noise = np.sqrt(variance) * rng.standard_normal(alpha.shape)
        shape = outline(Coverage((alpha + noise).astype(np.float32), 0 * variance, box), optics)
        samples[k] = *shape.center_px, shape.angular_radius_rad
    sampled = 2 * np.cov(samples.T)  # two pixels with a common error count as one
    bound = 5 * np.sqrt((np.outer(np.diag(sampled), np.diag(sampled)) + sampled**2) / (n - 1))
    np.testing.assert_array_less(np.abs(stated.cov_px - plain.cov_px - sampled[:2, :2]), bound[:2, :2])
    assert stated.angular_radius_var - plain.angular_radius_var == pytest.approx(sampled[2, 2], abs=bound[2, 2])
    assert abs(sampled[0, 1]) > 2 * bound[0, 1]  # or the test could not tell


@pytest.mark.parametrize("radius", [10, 25])
@pytest.mark.parametrize("blur_px", [0.3, 1, 2, 3])
def test_a_defocused_disc_stays_where_it_is_beside_dark_and_bright_background(radius, blur_px, optics, rng):
    """The lens blurs light; the camera's tone curve, that of sRGB, makes levels of it: in these the disc's half before
    the dark background grows, and the hue ends before the bright one.  Mixing levels leaves it 1.4 to 2.4 px off."""
    center = 150.3, 120.6
    v, u = (np.mgrid[:960, :1280] - 1.5) / 4
    before = np.where(u < center[0], 20.0, 200.0)[..., None]
    light = np.where(np.hypot(u - center[0], v - center[1])[..., None] < radius, (200.0, 30.0, 30.0), before)
    pixels = cv2.resize(light, (320, 240), interpolation=cv2.INTER_AREA)
    share = cv2.GaussianBlur(pixels, (0, 0), blur_px) / 255
    levels = 255 * np.where(share < 0.0031308, 12.92 * share, 1.055 * share ** (1 / 2.4) - 0.055)
    image = np.clip(np.rint(levels + rng.normal(0, 1, levels.shape)), 0, 255).astype(np.uint8)
    shape = fit_outline(image, threshold(MarkerParams(hue_deg=0), image) > 0, FULL, optics)
    assert shape is not None
    assert np.linalg.norm(shape.center_px - center) < max(0.2 * blur_px, 0.25)
    assert abs(np.sqrt(shape.area_px / np.pi) - radius) < 0.15
    assert 0.55 * blur_px < shape.blur_px < max(blur_px, 0.4)


def test_perspective_does_not_pull_the_center(optics):
    """Wide aside and near, the plain centroid of a sphere's image is off by over half a pixel."""
    sphere = Sphere(np.array([-0.12, 0.06, 0.2]), 0.035, RED)
    hard = _hard(LEFT_EYE, sphere)
    true = LEFT_EYE.project(sphere.center)
    rows, columns = np.nonzero(hard)
    assert np.linalg.norm([columns.mean() - true[0], rows.mean() - true[1]]) > 0.5
    shape = outline(cover(look(View(LEFT_EYE, np.eye(4)), [sphere]), hard, FULL), optics)
    assert np.linalg.norm(shape.center_px - true) < 0.12


def test_harmonics_are_those_of_the_edge():
    """Far off the axis a ball's image is an ellipse, and its edge has none.  On the axis an edge has those it was drawn
    with; a square's second moment is π/3 of a disc's."""
    wide = Camera(320, 240, 220.0, 220.0, 159.5, 119.5)
    aside = _hard(wide, Sphere(np.array([-0.14, 0.0, 0.25]), 0.03, RED))
    ball = outline(Coverage(aside.astype(np.float32), np.zeros(aside.shape, np.float32), FULL), Optics(wide))
    assert np.abs([*ball.harmonics, ball.non_circularity]).max() < 0.006
    rows, columns = np.nonzero(aside)
    assert np.ptp(columns) > 1.1 * np.ptp(rows)
    camera = Camera(100, 100, 900.0, 900.0, 49.5, 49.5)
    y, x = np.mgrid[:100, :100] - 49.5
    angle = np.arctan2(y, x)
    share = np.array([0.03, -0.02, 0.01, 0.025])
    waves = np.stack([np.cos(2 * angle), np.sin(2 * angle), np.cos(3 * angle), np.sin(3 * angle)], axis=-1)
    edge = 30 * (1 + waves @ share)
    square = np.clip(30.5 - np.abs(x), 0, 1) * np.clip(30.5 - np.abs(y), 0, 1)
    disc = np.clip(30.5 - np.hypot(x, y), 0, 1)
    waved, squared, *blurred = (
        outline(Coverage(alpha.astype(np.float32), np.zeros((100, 100), np.float32), (0, 0, 100, 100)), Optics(camera))
        for alpha in (
            np.clip(edge - np.hypot(x, y) + 0.5, 0, 1),
            square,
            *(cv2.GaussianBlur(disc, (0, 0), std_px) for std_px in (1.0, 3.0)),
        )
    )
    np.testing.assert_allclose(waved.harmonics, share, atol=0.003)
    assert squared.non_circularity == pytest.approx(np.pi / 3 - 1, abs=0.003)
    assert np.abs([shape.non_circularity for shape in blurred]).max() < 0.002  # 4σ²/r²: 0.004 and 0.04


@pytest.mark.parametrize("kind", ["cut by the border", "half hidden"])
def test_the_covariance_of_a_part_covers_its_distance_from_the_whole(kind, rng):
    """Hidden up to three fifths, its size known to 3 %: mean squared normalised error of the centre."""
    camera = Camera(120, 120, 220.0, 220.0, 59.5, 59.5)
    radius = 0.03
    n = 40
    optics = Optics(camera)
    squared = []
    for _ in range(n):
        center = np.array([*rng.uniform(-0.01, 0.01, 2), 0.35]) - [0.085 * (kind == "cut by the border"), 0, 0]
        sphere = Sphere(center, radius, RED)
        image = look(View(camera, np.eye(4)), [sphere], rng)
        hard = _hard(camera, sphere)
        if kind == "half hidden":
            u = int(camera.project(center)[0]) + rng.integers(-3, 8)
            image[:, u:] = (60, 90, 140)
            hard[:, u:] = False
        expected_px = np.pi * (radius * (1 + 0.03 * rng.standard_normal()) / 0.35 * 220) ** 2
        shape = fit_outline(image, hard, (0, 0, 120, 120), optics, expected_px)
        assert shape.is_partial
        error = shape.center_px - camera.project(center)
        squared.append(error @ np.linalg.solve(shape.cov_px, error) / 2)
    assert 0.6 < np.mean(squared) < 1.2


def test_a_disc_or_an_outline_of_the_expected_area_is_whole(optics, rng):
    sphere = Sphere(np.array([0.0, 0.02, 0.35]), 0.035, RED)
    image = look(View(LEFT_EYE, np.eye(4)), [sphere], rng)
    hard = _hard(LEFT_EYE, sphere)
    whole, free = (fit_outline(image, hard, FULL, optics, area) for area in (float(hard.sum()), None))
    smaller = fit_outline(image, hard, FULL, optics, 1.3 * hard.sum())
    part = hard & (np.arange(hard.shape[1]) < np.nonzero(hard)[1].mean() + 8)
    hidden = fit_outline(image, part, FULL, optics, float(hard.sum()))
    assert (whole.is_partial, free.is_partial, smaller.is_partial, hidden.is_partial) == (False, False, False, True)
    np.testing.assert_array_equal(whole.cov_px, free.cov_px)
    assert hidden.cov_px[0, 0] > 10 * whole.cov_px[0, 0]


@pytest.mark.parametrize(
    ("sides", "filled", "expected"),
    [
        (((20, 20), (22, 20), (20, 22)), (1.0,), True),
        (((23, 20), (20, 23)), (1.0,), False),
        (((20, 20),), (1.1, 0.91), True),
        (((20, 20),), (4 / np.pi, 0.88), False),  # a square, and less than a disc
    ],
)
def test_a_disc_s_box_is_as_wide_as_high_and_filled_like_one(sides, filled, expected):
    for (width, height), share in product(sides, filled):
        area = share * np.pi / 4 * width * height
        box = (0.0, 0.0, width, height)
        assert Outline(np.zeros(2), np.eye(2), 0.1, 1e-6, box, area, False).is_disc == expected


@pytest.mark.parametrize(
    ("corner", "size", "inwards"),
    [
        ((0, 60), (30, 20), (1, 0)),
        ((60, 0), (20, 30), (0, 1)),
        ((290, 60), (30, 20), (-1, 0)),
        ((60, 210), (20, 30), (0, -1)),
    ],
)
def test_what_reaches_the_image_s_border_is_cut_off(corner, size, inwards):
    """The left, upper, right and lower border; a pixel away from it, it is whole."""
    w, h = size
    for off, is_partial in (((0, 0), True), (inwards, False)):
        x, y = np.add(corner, off)
        mask = np.zeros((240, 320), bool)
        mask[y : y + h, x : x + w] = True
        shape = outline(cover(drawn(mask), mask, FULL), Optics(Camera(320, 240, 400.0, 400.0, 159.5, 119.5)))
        assert shape.is_partial == is_partial
        assert shape.box_px == (x, y, w, h)
        assert shape.area_px == pytest.approx(w * h, rel=0.02)


@pytest.mark.parametrize("hidden_below", [-0.8, -0.3, 0.0, 0.6])
def test_a_disc_behind_a_hand_is_fitted_at_its_visible_edge_if_enough_of_it_shows(hidden_below, rng):
    """Antialiased by supersampling, with noise; the hand hides the lower part and is foreground."""
    v, u = (np.mgrid[:960, :960] / 8 - 0.4375).reshape(2, 120, 8, 120, 8).swapaxes(2, 3)
    for _ in range(10):
        center = 60 + rng.uniform(-1, 1, 2)
        ball = np.hypot(u - center[0], v - center[1]) < 18
        hand = v > center[1] + 18 * hidden_below
        colors = np.where(hand[..., None], (150.0, 120.0, 90.0), np.where(ball[..., None], RED, (60.0, 90.0, 140.0)))
        image = np.clip(colors.mean(axis=(2, 3)) + rng.normal(0, 3, (120, 120, 3)), 0, 255).astype(np.uint8)
        visible = (ball & ~hand).mean(axis=(2, 3))
        foreground = hand.mean(axis=(2, 3)) > 0.5
        angles = 2 * np.pi * np.arange(48) / 48
        outward = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        predicted = center + rng.uniform(-2, 2, 2)
        evidence = (2 * visible - 1).astype(np.float32)
        region = evidence, foreground, (0, 0, 120, 120)
        fit = fit_visible_edge(image, *region, predicted + 17.0 * outward, outward, 2.0)
        assert (fit is None) == (hidden_below == -0.8)
        if fit is not None:
            error = np.array([*(predicted + fit.shift_px - center), fit.farther_px - 1.0])
            assert np.abs(error).max() < 0.2
            assert error @ np.linalg.solve(fit.cov, error) < 16.3  # 99.9 %


@pytest.mark.parametrize(("expected_px", "missing"), [(True, 0.5), (False, 0.3)])
def test_what_is_hidden_of_no_disc_may_lie_to_any_side(expected_px, missing):
    """Half a disc's centroid is 4/(3π) of its radius off; half a square gets that variance, and a part cut off by
    the border a proportional one, for an assumed hidden share of three tenths."""
    optics = Optics(Camera(320, 240, 2000.0, 2000.0, 159.5, 119.5))
    mask = np.zeros((240, 320), bool)
    mask[100:160, 140:170] = expected_px
    mask[100:160, :30] |= not expected_px
    visible = outline(cover(drawn(mask), mask, FULL), optics)
    result = fit_outline(drawn(mask), mask, FULL, optics, 3600.0 if expected_px else None)
    assert result.is_partial
    off = 4 / (3 * np.pi) * np.sqrt(visible.area_px / (1 - missing) / np.pi) * missing / 0.5
    assert np.trace(result.cov_px - visible.cov_px) == pytest.approx(off**2, rel=0.1)
    np.testing.assert_array_equal(result.center_px, visible.center_px)


def test_a_disc_is_completed_where_most_of_its_edge_shows(optics):
    """Two thirds of a disc that end at its centre; a cross of equal area has two thirds of its edge inside the disc;
    the arc of a third of it shows the disc, of less than a quarter it does not."""
    v, u = np.mgrid[:240, :320]
    whole = disc(160, 120, 30)
    sector = np.abs(np.arctan2(v - 120, u - 160)) < 2 / 3 * np.pi
    cross = (np.abs(u - 160) < 10) | (np.abs(v - 120) < 10)
    shapes = []
    for part, is_completed in ((sector, True), (cross, False), (u < 150, True), (u < 142, False)):
        mask = whole & part
        shapes.append(fit_outline(drawn(mask), mask, FULL, optics, np.pi * 30**2))
        assert (shapes[-1].area_px == np.pi * 30**2) == is_completed
    for shape in shapes[:2]:
        assert shape.is_partial
        assert np.linalg.norm(shape.center_px - [160, 120]) < 0.5
    completed = shapes[0]
    np.testing.assert_allclose(completed.box_px, (130, 90, 60, 60), atol=0.5)
    exact = outline(cover(drawn(whole), whole, FULL), optics)
    assert completed.angular_radius_rad == pytest.approx(exact.angular_radius_rad, rel=0.02)
    assert completed.angular_radius_var == pytest.approx((0.03 * completed.angular_radius_rad) ** 2)

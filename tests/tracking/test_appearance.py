"""Colour bins, particles, masks and the marker, each against something simpler."""

import colorsys

import numpy as np
import pytest
from ball_scenes import Sphere, look
from scipy import ndimage

from pps_vision.geometry.camera import View
from pps_vision.robot.icub import LEFT_EYE
from tracking import masks
from tracking.appearance import N_BINS, ColorModel, all_colors, color_bins, histogram, is_same_object
from tracking.marker import MarkerParams, find_markers, threshold
from tracking.outline import Optics
from tracking.particle_filter import Particles, resample


def test_bins_are_hue_and_saturation_or_value(rng: np.random.Generator) -> None:
    image = rng.integers(0, 256, (40, 40, 3), dtype=np.uint8)
    bins = color_bins(image)
    agree = 0
    for rgb, got in zip(image.reshape(-1, 3), bins.ravel(), strict=True):
        h, s, v = colorsys.rgb_to_hsv(*((rgb // 4 * 4 + 2) / 255))
        grey = s < 40 / 255 or v < 25 / 255
        agree += got == (100 + min(int(v * 10), 9) if grey else 10 * int(h * 10) + min(int(s * 10), 9))
    assert agree > 0.96 * bins.size  # the rest lies on the edges, where 8-bit hues round


def test_what_is_too_dark_has_no_hue(rng: np.random.Generator) -> None:
    image = rng.integers(0, 24, (40, 40, 3), dtype=np.uint8)
    np.testing.assert_array_equal(color_bins(image), 100)


def test_a_color_only_the_object_has_is_the_object() -> None:
    red, blue = np.zeros((8, 8, 3), np.uint8), np.zeros((8, 8, 3), np.uint8)
    red[..., 0], blue[..., 2] = 200, 200
    model = ColorModel(histogram(color_bins(red)), histogram(color_bins(blue)))
    table = model.table()
    assert table[color_bins(red)[0, 0]] > 0.9
    assert table[color_bins(blue)[0, 0]] == 0
    assert model.similarity(model.object) == pytest.approx(1)
    assert model.similarity(model.background) == 0
    half = model.blend(ColorModel(model.background, model.object), 0.5, 0.25)
    assert half.similarity(model.object) == pytest.approx(np.sqrt(0.5))
    np.testing.assert_allclose(half.background, 0.75 * model.background + 0.25 * model.object)
    rare = ColorModel(0.999 * model.object + 0.001 * model.background, np.zeros(N_BINS))
    assert rare.table()[color_bins(blue)[0, 0]] < 0.5  # one pixel in a thousand of the object, none elsewhere
    assert histogram(np.zeros((2, 2), np.uint8), np.zeros((2, 2), np.float32)).sum() == pytest.approx(1)
    assert len(table) == N_BINS


def test_resampling_keeps_each_particle_as_often_as_it_weighs(rng: np.random.Generator) -> None:
    weights = rng.dirichlet(np.ones(50))
    particles = Particles(np.column_stack([np.arange(50.0), np.zeros(50), np.ones(50)]), np.zeros((50, 3)))
    counts = np.bincount(resample(particles, weights, rng).current[:, 0].astype(int), minlength=50)
    assert np.all(np.abs(counts - 50 * weights) < 1)


def test_mask_operations_are_those_of_mathematical_morphology(rng: np.random.Generator) -> None:
    mask = ndimage.gaussian_filter(rng.standard_normal((60, 70)), 3) > 0.02
    box = np.ones((5, 5))
    np.testing.assert_array_equal(masks.dilated(mask, 2), ndimage.binary_dilation(mask, box))
    labels, _ = ndimage.label(mask)
    where = np.zeros_like(mask)
    where[20:40, 20:50] = True
    best = np.bincount(labels[where & mask]).argmax()
    one = masks.component(mask, where)
    assert one is not None
    np.testing.assert_array_equal(one, labels == best)
    np.testing.assert_array_equal(masks.filled(one), ndimage.binary_fill_holes(one, np.ones((3, 3))))
    assert masks.component(np.zeros_like(mask), where) is None
    for radius in (1, 2, 5):
        y, x = np.ogrid[-radius : radius + 1, -radius : radius + 1]
        wide = np.pad(mask, radius, constant_values=True)
        opened = ndimage.binary_opening(wide, x * x + y * y <= radius * radius)[radius:-radius, radius:-radius]
        inner = np.s_[2 * radius : -2 * radius, 2 * radius : -2 * radius]
        np.testing.assert_array_equal(masks.opened(mask, radius)[inner], opened[inner])


def test_large_gaps_that_show_the_backdrop_stay_open() -> None:
    ring = np.zeros((40, 40), bool)
    ring[5:35, 5:35] = True
    ring[10:20, 10:20] = ring[25:30, 25:30] = ring[7, 7] = False
    backdrop = np.zeros((40, 40), bool)
    backdrop[:22] = True
    whole = masks.filled(ring, backdrop)
    assert not whole[10:20, 10:20].any()
    assert whole[25:30, 25:30].all()
    assert whole[7, 7]
    assert np.count_nonzero(whole) == 30 * 30 - 100


@pytest.mark.parametrize(("hue_deg", "color"), [(120.0, (30.0, 200.0, 40.0)), (0.0, (200.0, 30.0, 40.0))])
def test_a_marker_is_found_by_its_hue(
    rng: np.random.Generator, hue_deg: float, color: tuple[float, float, float]
) -> None:
    optics = Optics(LEFT_EYE)
    center = np.array([0.03, -0.02, 0.4])
    image = look(View(LEFT_EYE, np.eye(4)), [Sphere(center, 0.01, color)], rng)
    true = LEFT_EYE.project(center)
    found = find_markers(MarkerParams(hue_deg=hue_deg), image, optics)
    assert np.linalg.norm(found[0].center_px - true) < 0.2
    near = find_markers(MarkerParams(hue_deg=hue_deg), image, optics, (float(true[0]) + 3, float(true[1]) - 3, 15.0))
    assert np.linalg.norm(near[0].center_px - true) < 0.2
    assert find_markers(MarkerParams(hue_deg=240.0), image, optics) == []
    assert find_markers(MarkerParams(hue_deg=hue_deg), image, optics, (-50.0, -50.0, 10.0)) == []


def test_markers_come_in_the_order_of_area_and_roundness() -> None:
    """A disc, a square of less area, a streak of more than either, 8 px; what is smaller is no marker."""
    image = np.full((240, 320, 3), 90, np.uint8)
    v, u = np.mgrid[:240, :320]
    image[(np.hypot(v - 60, u - 60) < 12) | ((v >= 150) & (v < 170) & (u >= 50) & (u < 70))] = (25, 200, 60)
    image[200:208, 150:230] = image[20:22, 200:203] = image[100:102, 200:204] = (25, 200, 60)
    found = [one.center_px for one in find_markers(MarkerParams(), image, Optics(LEFT_EYE))]
    np.testing.assert_allclose(found, [(60, 60), (59.5, 159.5), (189.5, 203.5), (201.5, 100.5)], atol=1.0)


@pytest.mark.parametrize(
    ("least", "row"), [("min_value", [(0, 204, 0), (0, 203, 0)]), ("min_saturation", [(51, 255, 51), (52, 255, 52)])]
)
def test_what_has_the_least_value_or_saturation_is_of_the_marker(least: str, row: list[tuple[int, int, int]]) -> None:
    """Value = largest of the three, saturation = (largest − smallest) / largest: 0.8, and 0.796."""
    params = MarkerParams(**{"min_value": 0.0, "min_saturation": 0.0, least: 0.8})
    assert threshold(params, np.array([row], np.uint8)).tolist() == [[255, 0]]


def test_bad_parameters_are_named() -> None:
    with pytest.raises(ValueError, match="hue 400"):
        MarkerParams(hue_deg=400.0)


def model(share: float) -> ColorModel:
    """A share of one colour, the rest of another."""
    colors = np.zeros(N_BINS)
    colors[[3, 40]] = share, 1 - share
    return ColorModel(colors, np.full(N_BINS, 1 / N_BINS))


@pytest.mark.parametrize(
    ("left", "right", "radius_m", "same"),
    [
        (0.9, 0.9, 0.03, True),
        (0.8, 0.95, 0.025, True),
        (0.9, 0.1, 0.03, False),  # another colour in one eye
        (0.1, 0.9, 0.03, False),
        (0.9, 0.9, 0.02, False),  # another size
        (0.9, 0.9, 0.04, False),
    ],
)
def test_colours_in_either_eye_and_size_must_agree(left: float, right: float, radius_m: float, same: bool) -> None:
    known, found = (model(0.9), model(0.9)), (model(left), model(right))
    assert is_same_object(known, 0.03, found, radius_m) == same


def test_a_marker_has_no_colours_to_compare() -> None:
    assert is_same_object((None, model(0.9)), 0.03, (model(0.1), None), 0.03)


def test_pixels_count_by_their_weights() -> None:
    counted = histogram(np.array([[3, 3, 5]], np.uint8), np.array([[1.0, 2.0, 1.0]], np.float32))
    np.testing.assert_allclose(counted[[3, 5]], [0.75, 0.25])
    assert counted.sum() == pytest.approx(1)
    np.testing.assert_allclose(histogram(np.array([3, 3, 5, 7], np.uint8))[[3, 5, 7]], [0.5, 0.25, 0.25])


def test_the_backdrop_has_more_of_a_colour_than_one_pixel_in_250_beyond_the_object() -> None:
    colors, around = np.zeros(N_BINS), np.zeros(N_BINS)
    colors[:3], around[:4] = (0.2, 0.2, 0.6), (0.1, 0.202, 0.61, 0.003)
    assert np.flatnonzero(ColorModel(colors, around).backdrop()).tolist() == [2]
    around[3] = 0.005
    assert np.flatnonzero(ColorModel(colors, around).backdrop()).tolist() == [2, 3]


def test_all_colours_are_the_middles_of_their_steps() -> None:
    """Two bits a channel: 32, 96, 160, 224, blue changing fastest, as they are counted."""
    colors = all_colors(2)
    assert colors.shape == (1, 64, 3)
    assert colors[0, :5].tolist() == [[32, 32, 32], [32, 32, 96], [32, 32, 160], [32, 32, 224], [32, 96, 32]]
    assert colors[0, 63].tolist() == [224, 224, 224]

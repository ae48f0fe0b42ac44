"""One camera's box tracker: where the object is, how sure it is, and what it takes for another thing."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from pps_vision.errors import InputError
from pps_vision.experiments.independent_scenes import procedural
from pps_vision.types import Array, Image
from tracking import box_tracker, template
from tracking.appearance import ColorModel, color_bins
from tracking.box_tracker import (
    ALIKE,
    LEAST_SCORE,
    LOST_SCORE,
    Appearance,
    BoxDetection,
    BoxPx,
    BoxTracker,
    TemplateTracker,
    _gives_back,
    _regions,
    assumed_optics,
    confidence,
)
from tracking.image_tracker import ImageTrackerParams


def _tracker(rng: np.random.Generator, appearance: Appearance | None = None) -> BoxTracker:
    return BoxTracker(ImageTrackerParams(), rng, appearance)


def _overlap(a: BoxPx, b: BoxPx) -> float:
    w = max(min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0]), 0.0)
    h = max(min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1]), 0.0)
    return w * h / (a[2] * a[3] + b[2] * b[3] - w * h)


def _textured(k: int, rng: np.random.Generator, hidden: bool = False) -> tuple[Image, BoxPx]:
    """A piece of a texture, 60 × 44 px and growing, over other pieces of the same texture: colours do not tell."""
    grain = procedural(3).astype(np.float32)
    whole = np.clip(110 + 2 * (grain - cv2.GaussianBlur(grain, (0, 0), 6)), 0, 255).astype(np.uint8)
    scene, piece = whole[:360, :480], whole[380:424, 500:560]
    w, h = 60 * 1.006**k, 44 * 1.006**k
    x, y = 120 + 2.5 * k + 8 * np.sin(0.3 * k), 130 + 30 * np.sin(0.1 * k)
    image = scene.copy()
    if not hidden:
        M = np.array([[w / 60, 0, x + (w / 60 - 1) / 2], [0, h / 44, y + (h / 44 - 1) / 2]])
        drawn = cv2.warpAffine(piece, M, (480, 360), flags=cv2.INTER_LINEAR)
        inside = cv2.warpAffine(np.full(piece.shape[:2], 255, np.uint8), M, (480, 360), flags=cv2.INTER_NEAREST) > 0
        image[inside] = np.asarray(drawn)[inside]
    noisy = image + 3 * rng.standard_normal(image.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8), (x, y, w, h)


def test_what_looks_like_its_surroundings_is_followed_by_its_template(rng: np.random.Generator) -> None:
    """The boxes are those that were drawn; CSRT, which is given the same first box, is not far better."""
    films = [_textured(k, rng) for k in range(60)]
    image, box = films[0]
    ours, csrt = _tracker(rng), cv2.TrackerCSRT.create()
    ours.start(image, box)
    csrt.init(image, tuple(round(value) for value in box))
    found = [(ours.step(image).box_px, csrt.update(image)[1]) for image, _ in films[1:]]
    overlap = [[_overlap(one, true) for one in pair] for pair, (_, true) in zip(found, films[1:], strict=True)]
    mean, mean_csrt = np.mean(overlap, axis=0)
    print(f"IoU {mean:.2f}, CSRT {mean_csrt:.2f}; similarity {ours.similarity:.2f}")
    assert mean > 0.8
    assert mean > mean_csrt - 0.05
    assert ours.appearance == "template"
    assert ours.similarity >= ALIKE


def test_an_object_that_is_gone_gets_a_low_score_and_is_found_again(rng: np.random.Generator) -> None:
    tracker = _tracker(rng)
    tracker.start(*_textured(0, rng))
    scores = [tracker.step(_textured(k, rng)[0]).score for k in range(1, 15)]
    gone = [tracker.step(_textured(k, rng, hidden=True)[0]).score for k in range(15, 25)]
    back = [(tracker.step(image), box) for image, box in (_textured(k, rng) for k in range(25, 37))]
    assert LEAST_SCORE <= min(scores) <= max(scores) <= 1
    assert 0 <= min(gone) <= max(gone) < LOST_SCORE
    assert _overlap(back[-1][0].box_px, back[-1][1]) > 0.6
    assert back[-1][0].score >= LEAST_SCORE


def _scene(rng: np.random.Generator) -> Image:
    return cv2.resize(rng.integers(60, 150, (30, 40, 3), dtype=np.uint8), (640, 480), interpolation=cv2.INTER_CUBIC)


def _draw(scene: Image, center: tuple[float, float], radius: float, rng: np.random.Generator) -> Image:
    """An orange ball with a white patch, blurred and noisy."""
    image = scene.copy()
    at = (round(16 * center[0]), round(16 * center[1]))
    cv2.circle(image, at, round(16 * radius), (240, 120, 20), cv2.FILLED, cv2.LINE_AA, 4)
    cv2.circle(
        image, (at[0] + round(5 * radius), at[1]), round(4 * radius), (235, 230, 220), cv2.FILLED, cv2.LINE_AA, 4
    )
    image = cv2.GaussianBlur(image, (0, 0), 1.0).astype(float)
    return np.clip(image + 3 * rng.standard_normal(image.shape), 0, 255).astype(np.uint8)


def test_it_follows_a_ball_that_moves_and_grows(rng: np.random.Generator) -> None:
    scene = _scene(rng)
    tracker = _tracker(rng)
    overlap = []
    for k in range(40):
        x, y, r = 200 + 150 * np.sin(0.12 * k), 230 + 80 * np.sin(0.2 * k), 18 + 0.4 * k
        image = _draw(scene, (x, y), r, rng)
        box = (x - r, y - r, 2 * r, 2 * r)
        found = tracker.start(image, box) if k == 0 else tracker.step(image)
        fx, fy, fw, fh = found.box_px
        w = max(min(fx + fw, x + r) - max(fx, x - r), 0)
        h = max(min(fy + fh, y + r) - max(fy, y - r), 0)
        overlap.append(w * h / (fw * fh + 4 * r * r - w * h))
    assert np.mean(overlap) > 0.85
    assert min(overlap) > 0.7


def test_a_ball_that_vanishes_has_a_low_score_and_is_found_again(rng: np.random.Generator) -> None:
    scene = _scene(rng)
    tracker = _tracker(rng)
    tracker.start(_draw(scene, (200, 200), 20, rng), (180, 180, 40, 40))
    assert tracker.step(_draw(scene, (203, 200), 20, rng)).score > 0.8
    gone = tracker.step(np.clip(scene + 3 * rng.standard_normal(scene.shape), 0, 255).astype(np.uint8))
    assert 0 <= gone.score < LOST_SCORE
    assert np.all(np.isfinite(gone.box_px))
    assert tracker.step(_draw(scene, (206, 200), 20, rng)).score > 0.8


def test_an_object_that_jumps_is_caught_again(rng: np.random.Generator) -> None:
    scene = _scene(rng)
    tracker = _tracker(rng)
    tracker.start(_draw(scene, (200, 200), 20, rng), (180, 180, 40, 40))
    found = [tracker.step(_draw(scene, (270, 245), 20, rng)) for _ in range(5)][-1]
    assert found.score > 0.8
    assert np.linalg.norm([found.box_px[0] + 20 - 270, found.box_px[1] + 20 - 245]) < 4


def test_bad_use_is_named(rng: np.random.Generator) -> None:
    tracker = _tracker(rng)
    image = np.zeros((48, 64, 3), np.uint8)
    with pytest.raises(ValueError, match="before start"):
        tracker.step(image)
    with pytest.raises(ValueError, match=r"60 5 10 10.*64×48"):
        tracker.start(image, (60, 5, 10, 10))


def _patterned(shift: tuple[int, int]) -> Image:
    """A texture that is shifted."""
    return np.roll(procedural(5), shift[::-1], axis=(0, 1))[:300, :400]


def test_the_response_is_largest_where_the_object_has_moved_to() -> None:
    center: Array = np.array([200.0, 150.0])
    learned = template.learn(_patterned((0, 0)), center, 40.0, (1.0, 1.0))
    cell_px = template.PADDING * 40.0 / template.CELLS
    for shift in ((0, 0), (12, -8), (-20, 16)):
        fit = template.response(learned, template.sample(_patterned(shift), center, 40.0))
        row, column = np.unravel_index(np.argmax(fit), fit.shape)
        at = (np.array([column, row]) - template.CELLS // 2) * cell_px
        np.testing.assert_allclose(at, shift, atol=0.51 * cell_px)


def test_the_filter_over_scales_finds_the_size_within_three_images(rng: np.random.Generator) -> None:
    scene, center, shape = _scene(rng), np.array([200.0, 150.0]), (1.0, 1.0)
    learned = template.learn(_draw(scene, (200, 150), 30, rng), center, 60.0, shape)
    for scale in (0.9, 0.95, 1.0, 1.05, 1.1):
        image, size = _draw(scene, (200, 150), 30 * scale, rng), 60.0
        for _ in range(3):
            size *= template.growth(learned, image, center, size, shape)
        assert size / 60 == pytest.approx(scale, abs=0.02)


def test_patches_of_any_size_show_the_same_place() -> None:
    """A ramp of brightness has its centre's level in the middle, also beyond the image's border and after averaging."""
    ramp = np.repeat(np.tile((np.arange(320) // 2).astype(np.uint8)[None], (240, 1))[..., None], 3, axis=2)
    for side in (40.0, 100.0, 230.0):
        patch = template._patch(ramp, np.array([161.0, 117.0]), (side, side), 24).astype(float)
        assert patch.mean() == pytest.approx(80.0, abs=1.0)
        assert patch[0, -1].mean() - patch[0, 0].mean() == pytest.approx(side / 2 * 23 / 24, abs=2.0)
    outside = template._patch(ramp, np.array([-500.0, 100.0]), (40.0, 40.0), 24)
    assert outside.max() == 0


def test_cells_of_one_colour_state_its_brightness_and_its_opponent_colours() -> None:
    """In units of the largest brightness, 255; brightness about its middle and halved."""
    found = template.cells(np.full((12, 12, 3), (120, 60, 30), np.uint8))
    expected = np.zeros((12, 3, 3))  # nothing has an edge
    expected[9:] = np.reshape([0.5 * (70 / 255 - 0.5), 60 / 255, 60 / 255], (3, 1, 1))
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_the_first_step_stays_with_the_nearer_of_two_alike(rng: np.random.Generator) -> None:
    """From the first box on the object counts as seen: the search begins where it was."""
    scene = _scene(rng)
    for seed in range(8):
        both = _draw(_draw(scene, (200, 200), 20, rng), (262, 200), 20, rng)
        tracker = _tracker(np.random.default_rng(seed), "template")
        tracker.start(both, (180, 180, 40, 40))
        x, y, w, h = tracker.step(_draw(_draw(scene, (203, 200), 20, rng), (259, 200), 20, rng)).box_px
        assert np.hypot(x + (w - 1) / 2 - 203, y + (h - 1) / 2 - 200) < 5


def test_an_object_that_turns_is_followed(rng: np.random.Generator) -> None:
    """A textured disc, by 1.5° an image: after 60 its template has nothing of the first."""
    texture, scene, tracker, overlap = procedural(7)[:120, :120], _scene(rng), _tracker(rng, "template"), []
    v, u = np.mgrid[:480, :640]
    for k in range(60):
        x, y = 150 + 2 * k, 200 + k
        turn = cv2.getRotationMatrix2D((60.0, 60.0), 1.5 * k, 1.0)
        turn[:, 2] += (x - 60.0, y - 60.0)
        turned, image = cv2.warpAffine(texture, turn, (640, 480)), scene.copy()
        disc = (u - x) ** 2 + (v - y) ** 2 < 30**2
        image[disc] = turned[disc]
        noisy = np.clip(image + 3 * rng.standard_normal(image.shape), 0, 255).astype(np.uint8)
        box = (x - 29.5, y - 29.5, 60.0, 60.0)
        found = tracker.start(noisy, box) if k == 0 else tracker.step(noisy)
        overlap.append(_overlap(found.box_px, box))
    assert min(overlap) > 0.6
    assert found.score >= LEAST_SCORE


@pytest.mark.parametrize(
    ("box", "taken"),
    [
        ((0.0, 0.0, 10.0, 10.0), True),
        ((54.0, 38.0, 10.0, 10.0), True),
        ((20.0, 20.0, 2.0, 2.0), True),
        ((-0.5, 5.0, 10.0, 10.0), False),
        ((5.0, -0.5, 10.0, 10.0), False),
        ((54.5, 5.0, 10.0, 10.0), False),
        ((5.0, 38.5, 10.0, 10.0), False),
        ((20.0, 20.0, 1.9, 10.0), False),
        ((20.0, 20.0, 10.0, 1.9), False),
        ((20.0, np.nan, 10.0, 10.0), False),
    ],
)
def test_a_first_box_lies_within_the_image(box: BoxPx, taken: bool, rng: np.random.Generator) -> None:
    image = rng.integers(0, 256, (48, 64, 3), dtype=np.uint8)
    if taken:
        assert _tracker(rng).start(image, box) == BoxDetection(box, 1.0)
    else:
        with pytest.raises(InputError, match="expected a box inside the 64×48 image"):
            _tracker(rng).start(image, box)


@pytest.mark.parametrize(("width", "height"), [(640, 480), (480, 640)])
def test_an_unknown_lens_sees_about_thirty_degrees(width: int, height: int) -> None:
    camera = assumed_optics(width, height).camera
    sides = [camera.bearing_map[v, u] for v, u in ((0, 0), (height - 1, width - 1))]
    assert (camera.width, camera.height) == (width, height)
    np.testing.assert_allclose(sides[0][:2], -sides[1][:2])
    longest = 2 * np.degrees(np.arctan2(max(np.abs(sides[0][:2])), sides[0][2]))
    assert longest == pytest.approx(30, abs=3)


def test_colours_follow_an_object_that_they_show_and_its_template_one_that_they_do_not(
    rng: np.random.Generator,
) -> None:
    """A ball of its own colour; a piece of the texture that is around it.  What is asked for is done."""
    ball, piece = _tracker(rng), _tracker(rng)
    ball.start(_draw(_scene(rng), (200, 200), 20, rng), (180, 180, 40, 40))
    piece.start(*_textured(0, rng))
    assert (ball.appearance, piece.appearance) == ("colour", "template")
    assert ball.similarity < 0.3 < ALIKE <= piece.similarity <= 1
    for appearance in ("colour", "template"):
        asked = _tracker(rng, appearance)
        asked.start(*_textured(0, rng))
        assert asked.appearance == appearance


def _on_ball(rng: np.random.Generator) -> TemplateTracker:
    """One that knows a ball of 20 px at (199.5, 199.5)."""
    image = _draw(_scene(np.random.default_rng(1)), (199.5, 199.5), 20, rng)
    return TemplateTracker(ImageTrackerParams(), image, (180.0, 180.0, 40.0, 40.0), rng)


def test_a_box_that_was_found_otherwise_is_judged_and_followed_if_it_holds_the_object(rng: np.random.Generator) -> None:
    tracker, image = _on_ball(rng), _draw(_scene(np.random.default_rng(1)), (299.5, 229.5), 22, rng)
    assert tracker.judge(image, (400.0, 100.0, 44.0, 44.0)) < LOST_SCORE
    assert tracker._state.center == pytest.approx([199.5, 199.5])  # nothing was learned from it
    assert tracker.judge(image, (278.0, 208.0, 44.0, 44.0)) > 0.8
    assert tracker._state.center == pytest.approx([299.5, 229.5])
    assert (tracker._state.size, tracker._state.lost) == (pytest.approx(44.0), 0)
    assert len(tracker._state.cloud.now) == ImageTrackerParams().particles
    x, y, w, h = tracker.step(image).box_px
    np.testing.assert_allclose([x + (w - 1) / 2, y + (h - 1) / 2], [299.5, 229.5], atol=2)


def test_a_size_is_at_least_six_pixels_and_at_most_nine_tenths_of_the_image(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracker = _on_ball(rng)
    for image, growth, size in (
        ((480, 640), 100.0, 432.0),
        ((480, 640), 1e-3, 6.0),
        ((480, 640), 2.0, 80.0),
        ((5, 5), 1.0, 6.0),
    ):
        monkeypatch.setattr(template, "growth", lambda *_, growth=growth: growth)
        assert tracker._grown(tracker._state, np.zeros((*image, 3), np.uint8)) == pytest.approx(size)


def test_a_lost_object_is_searched_where_it_was_and_ever_wider_around(rng: np.random.Generator) -> None:
    """Every other frame; by 15 % of its size of 40 px more a frame, within the image."""
    tracker, image = _on_ball(rng), np.zeros((480, 640, 3), np.uint8)
    for lost in (0, 2, 4):
        assert tracker._place(replace(tracker._state, lost=lost), image) == pytest.approx([199.5, 199.5])
    for lost, std in ((1, 46.0), (3, 58.0)):
        places = [tracker._place(replace(tracker._state, lost=lost), image) for _ in range(600)]
        np.testing.assert_allclose(np.mean(places, axis=0), 199.5, atol=8)
        np.testing.assert_allclose(np.std(places, axis=0), std, rtol=0.12)
    places = [tracker._place(replace(tracker._state, lost=101), image) for _ in range(100)]
    assert (np.min(places, axis=0).tolist(), np.max(places, axis=0).tolist()) == ([0, 0], [639, 479])


def test_while_an_object_is_gone_its_last_box_stays_with_a_low_score(rng: np.random.Generator) -> None:
    tracker, scene = _on_ball(rng), _scene(np.random.default_rng(1))
    found = [
        tracker.step(np.clip(scene + 3 * rng.standard_normal(scene.shape), 0, 255).astype(np.uint8)) for _ in range(4)
    ]
    assert max(one.score for one in found) <= 0.5 * LOST_SCORE
    assert [one.box_px for one in found] == [pytest.approx((180, 180, 40, 40))] * 4
    assert tracker._state.lost == 4


def test_what_is_remembered_moves_half_the_way_in_140_images(rng: np.random.Generator) -> None:
    one, other = _on_ball(rng)._state, _on_ball(rng)._state
    memory, newer = one.memory, other.memory
    for _ in range(139):
        memory = memory.blend(other.template, 2 * newer.cells, 3 * newer.colors)
    np.testing.assert_allclose(memory.colors, 0.5 * one.memory.colors + 1.5 * newer.colors, atol=5e-3)
    np.testing.assert_allclose(memory.cells, 0.5 * one.memory.cells + newer.cells, atol=5e-3)
    middle = 0.5 * (one.memory.template.places + other.template.places)
    np.testing.assert_allclose(memory.template.places, middle, atol=5e-3 * np.abs(middle).max())


def test_the_object_s_colours_are_those_inside_its_box_and_its_surroundings_those_around(
    rng: np.random.Generator,
) -> None:
    """Of a patch of 160 px, four sizes wide: four fifths of the box; from a tenth beside it up to half a size away."""
    for shape in ((1.0, 1.0), (1.5, 1 / 1.5)):
        inside, around, cells = _regions(shape)
        (w, h), away = (40 * side for side in shape), np.abs(np.arange(160) - 79.5)
        wide, high = np.array([[0.8 * s, 1.1 * s, s + 40] for s in (w, h)]) / 2
        boxes = [(away[:, None] < y) & (away < x) for x, y in zip(wide, high, strict=True)]
        np.testing.assert_array_equal(inside, boxes[0])
        np.testing.assert_array_equal(around, boxes[2] & ~boxes[1])
        assert cells.sum() == pytest.approx(1.1**2 * 100, rel=0.2)


@pytest.mark.parametrize(
    ("traits", "low", "high"),
    [
        ((1.0, 0.6, 1.6, 0.7), 0.9, 1.0),  # of its colours, before others, a clear peak, gradients alike
        ((1.0, 0.9, 1.1, 0.5), 0.0, LOST_SCORE),  # of its colours, which are around it too
        ((0.5, 0.5, 1.1, 0.9), 0.0, LOST_SCORE),  # gradients alone
        ((0.9, 0.6, 1.6, 0.5), LEAST_SCORE, 1.0),
        ((1e6, 0.0, 0.0, 0.0), 1 - 1e-12, 1.0),
        ((0.0, 1e6, 0.0, 0.0), 0.0, 1e-12),
    ],
)
def test_no_trait_alone_makes_an_object(traits: tuple[float, ...], low: float, high: float) -> None:
    assert low <= confidence(np.array(traits)) <= high


def test_an_object_in_the_middle_of_a_sample_has_its_own_traits(rng: np.random.Generator) -> None:
    """In the image that it was learned from; up to two cells of 4 px aside its response's peak counts, farther not."""
    image = _draw(_scene(np.random.default_rng(1)), (199.5, 199.5), 20, rng)
    tracker = TemplateTracker(ImageTrackerParams(), image, (180.0, 180.0, 40.0, 40.0), rng)

    def traits(aside_px: float) -> Array:
        seen = template.sample(image, np.array([199.5 + aside_px, 199.5]), 40.0)
        return tracker._traits(tracker._state, seen, *tracker._colors(seen))

    colors, around, peak, gradients = traits(0.0)
    assert (colors, gradients) == pytest.approx((1, 1), abs=1e-6)
    assert around == pytest.approx(tracker.similarity)
    assert around < 0.3
    fit = template.response(tracker._state.template, template.sample(image, np.array([199.5, 199.5]), 40.0))
    assert peak == pytest.approx(np.log(fit.max() / fit.std()), abs=1e-4)
    for way in (-1, 1):
        assert traits(8.0 * way)[2] > peak - 0.25
        assert traits(20.0 * way)[2] < peak - 0.5
    assert traits(160.0)[3] < 0.5


@pytest.mark.parametrize(("w", "h"), [(40, 40), (60, 30)])
def test_colours_gain_by_the_share_of_the_box_that_has_them(w: int, h: int, rng: np.random.Generator) -> None:
    """A box of one colour on another: all of it, half of it half a box aside, nothing a box aside."""
    image = np.full((400, 400, 3), (90, 90, 90), np.uint8)
    image[200 - h // 2 : 200 + h // 2, 200 - w // 2 : 200 + w // 2] = (200, 30, 30)
    tracker = TemplateTracker(ImageTrackerParams(), image, (200 - w / 2, 200 - h / 2, w, h), rng)
    seen, size = template.sample(image, np.array([199.5, 199.5]), float(np.sqrt(w * h))), np.sqrt(w * h)
    red, grey = np.zeros((2, 110))
    red[color_bins(image[200:201, 200:201])] = grey[color_bins(image[:1, :1])] = 1.0
    gain, middle = tracker._gain(ColorModel(red, grey), seen), template.CELLS // 2
    assert gain.shape == (template.CELLS, template.CELLS)
    for share in (0.0, 0.5, -0.5, 1.2):
        across, down = (round(share * side / (0.1 * size)) for side in (w, h))  # cells
        for found, cells, side in ((gain[middle, middle + across], across, w), (gain[middle + down, middle], down, h)):
            assert found == pytest.approx(1 - 2 * min(abs(cells) * 0.1 * size / side, 1), abs=0.13)


@pytest.mark.parametrize(
    ("lost", "score", "seen", "learned", "remembered"),
    [
        (0, 0.35, False, False, False),
        (0, 0.45, True, False, False),
        (0, 0.55, True, True, False),
        (0, 0.85, True, True, False),
        (0, 0.95, True, True, True),
        (3, 0.85, False, False, False),
        (3, 0.95, True, True, True),
    ],
)
def test_what_is_learned_depends_on_the_score(
    lost: int,
    score: float,
    seen: bool,
    learned: bool,
    remembered: bool,
    rng: np.random.Generator,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Seen from 0.4 on, found again from 0.9 on; learned from 0.5 on, remembered from 0.9 on."""
    tracker = _on_ball(rng)
    before = tracker._state = replace(tracker._state, lost=lost)
    monkeypatch.setattr(box_tracker, "confidence", lambda _: score)
    image = _draw(_scene(np.random.default_rng(1)), (202.5, 199.5), 20, rng)
    found, after = tracker.step(image), tracker._state
    assert found.score == (score if seen else 0.2)
    assert after.lost == (0 if seen else lost + 1)
    assert (after.template is not before.template, after.memory is not before.memory) == (learned, remembered)
    assert (after.model is not before.model) == learned
    if learned:
        colors, around = tracker._colors(template.sample(image, after.center, after.size))
        np.testing.assert_allclose(after.model.object, 0.97 * before.model.object + 0.03 * colors)
        np.testing.assert_allclose(after.model.background, 0.9 * before.model.background + 0.1 * around)


@pytest.mark.parametrize(("score", "follows"), [(0.45, False), (0.55, True)])
def test_a_box_that_is_judged_is_learned_from_one_half_on(
    score: float, follows: bool, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracker = _on_ball(rng)
    before = tracker._state = replace(tracker._state, lost=2)
    monkeypatch.setattr(box_tracker, "confidence", lambda _: score)
    assert tracker.judge(_scene(np.random.default_rng(1)), (280.0, 210.0, 50.0, 30.0)) == score
    assert (tracker._state is before) != follows
    if follows:
        assert tracker._state.center == pytest.approx([304.5, 224.5])
        assert (tracker._state.size, tracker._state.lost) == (pytest.approx(np.sqrt(1500)), 0)
        assert tracker._state.memory is not before.memory
        assert tracker._state.template is before.template


@pytest.mark.parametrize(
    ("similarity", "seen", "given_back"),
    [
        (0.2, (10.0, 20.0, 100.0, 50.0), True),
        (0.3, (10.0, 20.0, 100.0, 50.0), False),  # its colours are around it too
        (0.2, (18.0, 20.0, 100.0, 50.0), True),  # they share 92 of 108
        (0.2, (19.0, 20.0, 100.0, 50.0), False),
        (0.2, (10.0, 24.0, 100.0, 50.0), True),
        (0.2, (10.0, 15.0, 100.0, 50.0), False),  # 45 of 55
        (0.2, (10.0, 20.0, 86.0, 50.0), True),
        (0.2, (10.0, 20.0, 84.0, 50.0), False),
        (0.2, (210.0, 120.0, 100.0, 50.0), False),
        (0.2, None, False),
    ],
)
def test_colours_show_an_object_where_they_give_back_its_box(
    similarity: float, seen: BoxPx | None, given_back: bool
) -> None:
    model = SimpleNamespace(similarity=lambda _: similarity, background=None)
    tracker: Any = SimpleNamespace(step=lambda *_: (None, seen and SimpleNamespace(box_px=seen)))
    target: Any = SimpleNamespace(model=model)
    assert _gives_back(tracker, target, np.zeros((1, 1, 3), np.uint8), (10.0, 20.0, 100.0, 50.0)) == given_back


@pytest.mark.parametrize(
    ("by_color", "judged", "found", "result", "started"),
    [
        *((True, 0.5, 0.9, "colour", False), (True, 0.45, 0.5, "template", True)),
        *((True, 0.45, 0.45, "template", False), (False, 0.9, 0.9, "template", True)),
    ],
)
def test_colours_lead_where_the_template_confirms_them(
    by_color: bool, judged: float, found: float, result: str, started: bool, rng: np.random.Generator
) -> None:
    """Else the template searches, and from what it finds with certainty colours begin again, with what they knew."""
    boxes: dict[str, BoxPx] = {"colour": (1.0, 2.0, 30.0, 40.0), "template": (5.0, 6.0, 30.0, 40.0)}
    tracker, image, asked = _tracker(rng), np.zeros((60, 80, 3), np.uint8), list[Any]()
    target: Any = SimpleNamespace(model="model", fill=0.7)

    def start(*args: Any, **kwargs: Any) -> str:
        asked.append((args[1:], kwargs))
        return "anew"

    seen = SimpleNamespace(box_px=boxes["colour"]) if by_color else None
    colors: Any = SimpleNamespace(step=lambda *_: ("moved", seen), start=start)
    own: Any = SimpleNamespace(judge=lambda *_: judged, step=lambda _: BoxDetection(boxes["template"], found))
    tracker._template, tracker._by_color = own, (colors, target)
    assert tracker.step(image) == BoxDetection(boxes[result], judged if result == "colour" else found)
    assert asked == [((boxes["template"], "model"), {"fill": 0.7})] * started
    assert tracker._by_color == (colors, "anew" if started else "moved" if result == "colour" else target)

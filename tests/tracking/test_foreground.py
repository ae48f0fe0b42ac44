"""What has moved before a background, for masks of what differs that are drawn by hand."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pps_vision.geometry.camera import View
from pps_vision.robot.icub import LEFT_EYE
from pps_vision.types import Mask
from tracking.foreground import MovingForeground, StaticForeground

VIEW = View(LEFT_EYE, np.eye(4))
WHOLE = (0, 0, 120, 90)
THEN, NOW = (np.zeros((90, 120, 3), np.uint8) for _ in range(2))
NOTHING = np.zeros((90, 120), bool)


def disc(x: float, y: float, outer: float, inner: float = -1.0) -> Mask:
    v, u = np.mgrid[:90, :120]
    far = np.hypot(u - x, v - y)
    return np.asarray((far <= outer) & (far > inner))


def background(then: Mask, now: Mask, edge: float | None = None) -> Any:
    """A background from which the two images differ so, at rest and moving, and its share of an edge."""

    def differs(image: np.ndarray, _: View, box: tuple[int, int, int, int]) -> Mask:
        return (now if image is NOW else then)[box[1] : box[3], box[0] : box[2]]

    moving = SimpleNamespace(differs=differs, differs_in=differs)
    return SimpleNamespace(differs=differs, learned_edge=lambda *_: edge, moving=moving)


@pytest.mark.parametrize(
    ("differs", "confirmed"),
    [
        (disc(60, 45, 16), True),
        (disc(60, 45, 16, 12), True),  # two fifths of it: a plain thing's inside looks like what is behind it
        (disc(60, 45, 16, 14), False),  # a fifth of it
        (disc(60, 45, 16) & (np.arange(120) < 60), False),  # only one half has changed
        (disc(60, 45, 16, 12) & (np.arange(120) < 70), False),  # what it encloses is not all of it
        (disc(100, 45, 16), False),
        (NOTHING, False),
    ],
)
def test_colours_are_confirmed_where_what_differs_encloses_them(differs: Mask, confirmed: bool) -> None:
    """A disc of 15 px, in the whole image and in a box; whatever else differs that does not touch it."""
    box, colored = (30, 20, 90, 80), disc(60, 45, 15)
    for apart in (NOTHING, disc(10, 45, 5)):
        change = StaticForeground(background(NOTHING, differs | apart), VIEW, THEN, NOW)
        assert change.confirms(colored, WHOLE, True) == confirmed
        assert change.confirms(colored[20:80, 30:90], box, True) == confirmed
    assert not change.confirms(colored, WHOLE, False)
    assert MovingForeground(background(NOTHING, differs), VIEW, lambda _: None, NOW).confirms(colored, WHOLE, True)


@pytest.mark.parametrize(
    ("then", "seen"),
    [
        (disc(54, 45, 15), True),
        (disc(15, 45, 15), True),  # it was far away
        (disc(60, 45, 15), False),  # it rests
        (disc(59, 45, 15), False),  # covers 4 % anew
        (NOTHING, False),  # it has uncovered nothing
        (disc(54, 45, 15) | disc(20, 45, 15), False),  # it has uncovered far more than it covers
        (disc(52, 45, 15) & disc(60, 45, 17), False),  # far less
    ],
)
def test_before_an_eye_at_rest_what_moves_uncovers_as_much_as_it_covers(then: Mask, seen: bool) -> None:
    change = StaticForeground(background(then, disc(60, 45, 15)), VIEW, THEN, NOW)
    for x0, y0, x1, y1 in (WHOLE, (40, 25, 85, 70)):
        found = change.moved_mask(disc(60, 45, 3)[y0:y1, x0:x1], (x0, y0, x1, y1))
        assert (found is not None) == seen
        assert found is None or np.array_equal(found, disc(60, 45, 15)[y0:y1, x0:x1])


@pytest.mark.parametrize(
    ("then", "now", "edge", "seen"),
    [
        (disc(54, 45, 15), disc(60, 45, 15), None, True),
        (disc(54, 45, 15), disc(60, 45, 15), 0.55, True),
        (disc(54, 45, 15), disc(60, 45, 15), 0.65, False),  # rather the place that something has left
        (disc(60, 45, 15), disc(60, 45, 15), None, False),  # it rests
        (NOTHING, disc(60, 45, 15), None, False),  # it has uncovered nothing
        (
            disc(54, 45, 15) & disc(60, 45, 17),
            disc(60, 45, 15),
            None,
            True,
        ),  # it has uncovered a third of what it covers
        (disc(54, 45, 15) & disc(60, 45, 16), disc(60, 45, 15), None, False),  # a fifth
        (disc(54, 45, 15), disc(60, 45, 15) & ~disc(69, 38, 9), None, False),  # not solid
        (
            disc(54, 45, 15),
            disc(60, 45, 15) | (disc(60, 45, 60) & (abs(np.arange(90) - 45) < 12)[:, None]),
            None,
            False,
        ),
    ],
)
def test_before_an_eye_that_moves_what_moves_is_solid_and_uncovers_some(
    then: Mask, now: Mask, edge: float | None, seen: bool
) -> None:
    """The last one goes on beyond the box."""
    box = (30, 20, 90, 80)
    crop, known = np.s_[box[1] : box[3], box[0] : box[2]], background(then, now, edge)
    change = MovingForeground(known, VIEW, lambda _: THEN, NOW)
    found = change.moved_mask(disc(60, 45, 3)[crop], box)
    assert (found is not None) == seen
    assert found is None or np.array_equal(found, now[crop])
    assert MovingForeground(known, VIEW, lambda _: None, NOW).moved_mask(disc(60, 45, 3)[crop], box) is None
    assert change.disoccluded_mask(disc(60, 45, 3)[crop], box) is None


@pytest.mark.parametrize(
    ("then", "x", "y", "edge", "seen"),
    [
        (NOTHING, 60, 45, 0.3, True),
        (NOTHING, 60, 45, 0.65, False),
        (NOTHING, 60, 45, None, False),
        (disc(60, 45, 15), 60, 45, 0.3, False),  # it was there
        (NOTHING, 18, 45, 0.3, True),  # begins 3 px from the border
        (NOTHING, 17, 45, 0.3, False),
        (NOTHING, 60, 17, 0.3, False),
        (NOTHING, 102, 45, 0.3, False),
        (NOTHING, 60, 72, 0.3, False),
    ],
)
def test_what_emerges_is_new_and_within_the_image(then: Mask, x: int, y: int, edge: float | None, seen: bool) -> None:
    now = disc(x, y, 15)
    change = StaticForeground(background(then, now, edge), VIEW, THEN, NOW)
    found = change.disoccluded_mask(disc(x, y, 3), WHOLE)
    assert (found is not None) == seen
    assert found is None or np.array_equal(found, now)
    assert change.disoccluded_mask(disc(x + 30, y, 3) if x < 60 else disc(x - 30, y, 3), WHOLE) is None

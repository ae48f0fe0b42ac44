"""Shares of an edge across which the background changes more than the image, on drawn discs."""

import cv2
import numpy as np
import pytest

from pps_vision.types import Image, Mask
from tracking.moving_background import edge_of_background

WHOLE = (0, 0, 120, 90)


def disc(radius: int, level: float) -> tuple[Image, Mask]:
    """Image of a disc that is brighter than its surroundings by `level`; its mask."""
    mask = np.zeros((90, 120), np.uint8)
    cv2.circle(mask, (60, 45), radius, 1, cv2.FILLED)
    image = (100 + level * mask)[..., None].repeat(3, axis=2).astype(np.uint8)
    return image, mask.astype(bool)


@pytest.mark.parametrize(("covered", "learned", "share"), [(60, 0, 0.0), (0, 60, 1.0), (60, 50, 0.0), (50, 60, 1.0)])
def test_the_stronger_edge_decides(covered, learned, share):
    """All around a disc; also in a box, whose corner the mask begins at."""
    image, mask = disc(20, covered)
    mean, _ = disc(20, learned)
    assert edge_of_background(image, mean.astype(np.float32), 1.0, mask, WHOLE) == share
    part = mask[20:70, 30:90].copy()
    assert edge_of_background(image, mean.astype(np.float32), 1.0, part, (30, 20, 90, 70)) == share


@pytest.mark.parametrize(("gain", "share"), [(1.1, 0.0), (1.3, 1.0)])
def test_a_brighter_light_makes_the_background_s_edge_stronger(gain, share):
    """60 levels are as many as 50 under a light 1.2 times as bright."""
    image, mask = disc(20, 60)
    mean, _ = disc(20, 50)
    measured = edge_of_background(image, mean.astype(np.float32), gain, mask, WHOLE)
    assert measured == pytest.approx(share, abs=0.05)


@pytest.mark.parametrize(("known_to", "share"), [(60, 1.0), (48, None)])
def test_only_where_the_background_is_known(known_to, share):
    """The left half of an edge of 80 px at 60 px, a fifth at 48 px, where too few points of the edge are known."""
    image, mask = disc(14, 0)
    mean = disc(14, 60)[0].astype(np.float32)
    mean[:, known_to:] = -1.0
    assert edge_of_background(image, mean, 1.0, mask, WHOLE) == share


def test_the_image_s_border_is_no_edge():
    """Half of a disc is in view: only edge points whose both sides lie in the image count."""
    image, mask = disc(20, 0)
    mean, _ = disc(20, 60)
    cut = np.s_[:, 60:]
    share = edge_of_background(image[cut].copy(), mean[cut].astype(np.float32), 1.0, mask[cut].copy(), (0, 0, 60, 90))
    assert share == 1.0

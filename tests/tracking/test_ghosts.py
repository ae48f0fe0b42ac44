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


@pytest.mark.parametrize(
    ("radius", "covered", "learned", "gain", "known_to", "share"),
    [
        # the stronger edge decides
        (20, 60, 0, 1.0, 120, 0.0),
        (20, 0, 60, 1.0, 120, 1.0),
        (20, 60, 50, 1.0, 120, 0.0),
        (20, 50, 60, 1.0, 120, 1.0),
        # 60 levels are as many as 50 under a light 1.2 times as bright
        (20, 60, 50, 1.1, 120, 0.0),
        (20, 60, 50, 1.3, 120, 1.0),
        # the left half of an edge of 80 px, and a fifth, where too few points of the edge are known
        (14, 0, 60, 1.0, 60, 1.0),
        (14, 0, 60, 1.0, 48, None),
    ],
)
def test_the_stronger_edge_decides_where_the_background_is_known(radius, covered, learned, gain, known_to, share):
    """All around a disc; also in a box, whose corner the mask begins at."""
    image, mask = disc(radius, covered)
    mean = disc(radius, learned)[0].astype(np.float32)
    mean[:, known_to:] = -1.0
    expected = share if share is None else pytest.approx(share, abs=0.05 if gain != 1.0 else 0.0)
    assert edge_of_background(image, mean, gain, mask, WHOLE) == expected
    assert edge_of_background(image, mean, gain, mask[20:70, 30:90].copy(), (30, 20, 90, 70)) == expected


def test_the_image_s_border_is_no_edge():
    """Half of a disc is in view: only edge points whose both sides lie in the image count."""
    image, mask = disc(20, 0)
    mean = disc(20, 60)[0].astype(np.float32)
    cut = np.s_[:, 60:]
    share = edge_of_background(image[cut].copy(), mean[cut].copy(), 1.0, mask[cut].copy(), (0, 0, 60, 90))
    assert share == 1.0

"""Taxels that are not where the robot takes them to be, found by fingertips that touch them."""

from dataclasses import replace

import numpy as np
from data import SEED

from learning.pps.taxel_positions import PartTouch, verified_positions
from pps_vision.robot.skin import TOUCH_RADIUS_M, icub_skin

TRUE = icub_skin(("left_forearm",)).parts[0]
RADIUS_M = 0.01


def touches(n, rng):
    """Fingertips that come down on the skin and stop a radius from the nearest taxel."""
    ends = []
    while len(ends) < n:
        taxel = rng.integers(len(TRUE.ids))
        normal = TRUE.normals[taxel]
        heights = np.arange(0.06, -0.03, -1e-4)[:, None]
        path = TRUE.positions_m[taxel] + 0.015 * rng.standard_normal(3) + heights * normal
        gaps = np.linalg.norm(path[:, None] - TRUE.positions_m, axis=2) - RADIUS_M
        stops = (gaps <= 0).any(axis=1)
        if stops.any():
            k = stops.argmax()
            ends.append(PartTouch(path[k], RADIUS_M, gaps[k] <= TOUCH_RADIUS_M))
    return ends


def rms_m(part):
    return np.sqrt(np.mean(np.sum((part.positions_m - TRUE.positions_m) ** 2, axis=1)))


def test_a_hundred_touches_find_taxels_that_are_3_cm_off_and_shuffled_ones_change_nothing():
    rng = np.random.default_rng(SEED)
    ends = touches(100, rng)
    off = replace(TRUE, positions_m=TRUE.positions_m + 0.03 / np.sqrt(3) * rng.standard_normal(TRUE.positions_m.shape))
    assert rms_m(off) > 0.02
    assert rms_m(verified_positions(off, ends)) < 0.01
    felt = rng.permutation([end.touched for end in ends])
    assert verified_positions(TRUE, [replace(end, touched=t) for end, t in zip(ends, felt, strict=True)]) is TRUE
    assert verified_positions(off, ends[:2]) is off

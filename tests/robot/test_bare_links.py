"""Links without skin and how near a ball comes to them, against distances by hand."""

import numpy as np
import pytest

from pps_vision.robot.bare_links import BareLinks
from pps_vision.robot.icub import home, load_icub
from pps_vision.robot.skin import Skin, icub_skin

ROBOT = load_icub()
POSTURE = ROBOT.at(home(ROBOT))
ELBOW = POSTURE.point("right_lower_arm")  # the middle of a ball of 36 mm


def test_the_links_of_one_arm_that_carry_no_skin_are_bare():
    for parts, expected in (((), {"right_upper_arm", "right_lower_arm", "right_forearm", "right_palm"}),
                            (("right_forearm", "right_palm"), {"right_upper_arm", "right_lower_arm"})):  # fmt: skip
        skin = Skin(icub_skin(parts).parts)
        frames = {link.frame for link in BareLinks(ROBOT, skin, "right").nearest_points(POSTURE, ELBOW, 0.1)}
        assert frames == expected


@pytest.mark.parametrize(("away_m", "radius_m"), [(0.1, 0.02), (0.1, 0.0), (0.05, 0.02)])
def test_the_nearest_point_is_where_the_line_to_the_ball_leaves_the_link(away_m, radius_m):
    """Also of a ball that overlaps with the elbow, and of a point."""
    way = np.array([0.0, 1.0, 0.0])
    near = {
        link.frame: link
        for link in BareLinks(ROBOT, Skin(()), "right").nearest_points(POSTURE, ELBOW + away_m * way, radius_m)
    }
    elbow = near["right_lower_arm"]
    assert elbow.distance_m == pytest.approx(away_m - radius_m - 0.036, abs=2e-6)
    np.testing.assert_allclose(elbow.normal, way, atol=1e-5)
    np.testing.assert_allclose(elbow.point_root, ELBOW + 0.036 * way, atol=2e-5)


@pytest.mark.parametrize(("beyond_m", "is_near"), [(-0.01, True), (0.01, False)])
def test_half_a_metre_from_its_middle_a_link_is_no_longer_near(beyond_m, is_near):
    """To the surface of the ball."""
    center = ELBOW + np.array([0.0, 0.5 + 0.1 + beyond_m, 0.0])
    near = {link.frame: link for link in BareLinks(ROBOT, Skin(()), "right").nearest_points(POSTURE, center, 0.1)}
    elbow = near["right_lower_arm"]
    assert np.isfinite(elbow.distance_m) == is_near
    assert np.linalg.norm(elbow.normal) == pytest.approx(float(is_near))
    if not is_near:
        np.testing.assert_allclose(elbow.point_root, ELBOW, atol=1e-9)

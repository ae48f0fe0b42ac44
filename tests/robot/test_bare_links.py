"""Links without skin."""

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

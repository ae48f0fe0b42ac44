"""Parameters, bodies and solutions serve as defaults and are shared."""

from frozen import changeable_dataclasses


def test_no_parameters_and_no_description_of_a_robot_can_be_changed() -> None:
    assert changeable_dataclasses("pps_vision.robot") == []

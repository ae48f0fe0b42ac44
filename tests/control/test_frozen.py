"""Parameters and states serve as defaults and are shared."""

from frozen import changeable_dataclasses


def test_no_parameters_and_no_state_can_be_changed() -> None:
    assert changeable_dataclasses("control") == []

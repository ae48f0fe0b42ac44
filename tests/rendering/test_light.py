"""The light that surfaces reflect, worked out by hand from the lamps' directions."""

import numpy as np
import pytest

from rendering.renderer import diffuse_light

KEY, FILL, OPPOSITE = (np.array(lamp) for lamp in ((0.474, 0.237, 0.848), (0.10, -0.81, 0.58), (-0.72, 0.45, 0.53)))


@pytest.mark.parametrize(
    ("normal", "expected"),
    [
        (KEY, 0.55 + 0.38 + 0.16 * (KEY @ FILL) + 0.12 * (KEY @ OPPOSITE)),  # all three lamps
        (-KEY, 0.55 - 0.12),  # no lamp, and less than the ambient light
        ((0.0, 0.0, -1.0), 0.55 - 0.12 * 0.848),
        ((-1.0, 0.0, 0.0), 0.55 + 0.12 * 0.72 - 0.12 * 0.474),
        ((0.0, -1.0, 0.0), 0.55 + 0.16 * 0.81 - 0.12 * 0.237),
    ],
    ids=["to the key lamp", "away from it", "below", "behind", "right"],
)
def test_a_surface_has_ambient_light_and_that_of_the_lamps_it_faces(normal: np.ndarray, expected: float) -> None:
    assert diffuse_light(np.array([normal])) == pytest.approx(expected, abs=2e-4)

"""Light of the room: three directional lamps and ambient light on diffuse surfaces."""

import numpy as np

from pps_vision.types import Array

LAMPS = ((0.474, 0.237, 0.848), (0.10, -0.81, 0.58), (-0.72, 0.45, 0.53))  # root frame, unit: key, fill, opposite
STRENGTHS = (0.38, 0.16, 0.12)
AMBIENT = 0.55
_BELOW = 0.12  # ambient light lost on surfaces that face away from the key lamp


def diffuse_light(normals_root: Array) -> Array:
    """Return the light (n,) reflected by surfaces with unit normals (n, 3), as a factor on their colour.

    Lambert's law per lamp, plus ambient light, reduced on surfaces that face away from the key lamp.
    """
    facing = normals_root @ np.array(LAMPS).T
    light: Array = AMBIENT + np.maximum(facing, 0) @ np.array(STRENGTHS) + _BELOW * np.minimum(facing[:, 0], 0)
    return light

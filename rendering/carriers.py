"""Models of what holds the object: nothing, a stick, or an experimenter's hand."""

from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from pps_vision.geometry.se3 import rotation_to, transform
from pps_vision.types import Array
from rendering.names import CarrierName
from rendering.shapes import Color, Part, sides_of, sphere, tube

WOOD: Color = (0.42, 0.31, 0.22)
SKIN: Color = (0.86, 0.64, 0.52)
CLOTH: Color = (0.30, 0.34, 0.42)


def carrier_parts(name: CarrierName, radius_m: float, fineness: int) -> tuple[Part, ...]:
    """Return the parts that hold an object of `radius_m` at the origin; they extend along z, with y up."""
    if name not in get_args(CarrierName):
        raise ValueError(f"carrier {name!r}; expected one of {', '.join(get_args(CarrierName))}")
    if name == "none":
        return ()
    if name == "stick":
        return (tube([[0, 0, 0.5 * radius_m], [0, 0, 0.35], [0, 0, 0.7]], 0.005, WOOD, sides_of(fineness)),)
    return _hand(radius_m, fineness)


def _hand(radius: float, fineness: int) -> tuple[Part, ...]:
    """Four fingers from above and a thumb from below around the far half of a sphere."""
    wrist = radius + 0.115
    flat_ball = transform(np.diag([0.042, 0.021, 0.050]), (0, 0, radius + 0.07))
    sides = sides_of(fineness)
    fingers = ((40, 54), (72, 62), (104, 62), (136, 56))  # azimuth and bend, degrees
    return (
        Part(sphere(1.0, SKIN, fineness=max(fineness - 1, 0)).mesh.apply_transform(flat_ball), SKIN),
        *(_finger(radius, np.deg2rad(azimuth), bend_deg, sides) for azimuth, bend_deg in fingers),
        _finger(radius, np.deg2rad(-100), 56, sides, thickness=0.0095),
        tube([[0, 0, wrist - 0.02], [0, 0, wrist], [0, 0, wrist + 0.09]], [0.025, 0.023, 0.026], SKIN, sides),
        tube([[0, 0, wrist + 0.03], [0, 0, wrist + 0.3], [0, 0, wrist + 0.7]], [0.036, 0.044, 0.050], CLOTH, sides),
    )


def _finger(radius: float, azimuth: float, bend_deg: float, sides: int, thickness: float = 0.008) -> Part:
    """From the knuckle around the sphere to `bend_deg` from the carrier's axis."""
    out = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    axis = np.array([0.0, 0.0, 1.0])
    small = min(1.0, 0.35 + radius / 0.05)  # fingertips hold a small object from behind and leave it visible
    around = np.deg2rad(np.linspace(0.45, 1.0, 6) * bend_deg * small)[:, None]
    bow = radius + thickness + np.array([0.010, 0.011, 0.010, 0.007, 0.003, 0.0])[:, None]
    joints = bow * (np.sin(around) * out + np.cos(around) * axis)
    knuckle = np.array([0.032, 0.016, 0.0]) * out + axis * (radius + 0.055)
    return tube(np.vstack([knuckle, joints]), np.linspace(1.12, 0.82, 7) * thickness, SKIN, sides)


def carrier_pose(position: ArrayLike, direction: ArrayLike) -> Array:
    """Return `T_root_carrier` (4, 4): z from the object along `direction` to the carrier, y as vertical as possible."""
    z = rotation_to(direction)[:, 2]
    sideways = np.cross([0.0, 0.0, 1.0], z)
    if np.linalg.norm(sideways) < 1e-6:  # vertical: every rotation about z is equivalent
        return transform(rotation_to(z), position)
    x = sideways / np.linalg.norm(sideways)
    return transform(np.column_stack([x, np.cross(z, x), z]), position)

"""Stimuli (marker, ball, cube, octopus) and models of what holds them: nothing, a stick, or an experimenter's hand."""

from dataclasses import dataclass
from typing import get_args

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from pps_vision.errors import InputError
from pps_vision.geometry.se3 import rotation_to, transform
from pps_vision.types import Array
from rendering.names import CarrierName, StimulusName
from rendering.shapes import Color, Part, sides_of, sphere, tube

GREEN: Color = (0.05, 0.95, 0.15)
RED: Color = (0.95, 0.06, 0.08)
BLUE: Color = (0.06, 0.20, 0.95)
YELLOW: Color = (1.00, 0.85, 0.05)
VIOLET: Color = (0.55, 0.08, 0.90)
ORANGE: Color = (1.00, 0.45, 0.04)
WHITE: Color = (1.00, 1.00, 1.00)
BLACK: Color = (0.02, 0.02, 0.02)

WOOD: Color = (0.42, 0.31, 0.22)
SKIN: Color = (0.86, 0.64, 0.52)
CLOTH: Color = (0.30, 0.34, 0.42)

_RADIUS_M = {"marker": 0.010, "ball": 0.035, "cube": 0.030, "octopus": 0.040}


@dataclass(frozen=True)
class Stimulus:
    """`parts` in the object's frame, origin at its centre; `radius_m` is the radius of the sphere with the same mean
    silhouette."""

    name: str
    radius_m: float
    parts: tuple[Part, ...]


def make_stimulus(name: StimulusName, radius_m: float | None = None, fineness: int = 3) -> Stimulus:
    """Return a marker, ball, cube or octopus of its default radius or of `radius_m`."""
    if name not in get_args(StimulusName):
        raise InputError("stimulus", f"{name!r}; expected one of {', '.join(get_args(StimulusName))}")
    radius = _RADIUS_M[name] if radius_m is None else radius_m
    if not (np.isfinite(radius) and radius > 0):
        raise InputError("stimulus", f"radius {radius} m; expected a positive number")
    if name == "cube":
        return Stimulus(name, radius, _cube(radius))
    if name == "octopus":
        return Stimulus(name, radius, tuple(_octopus(radius * _OCTOPUS_SCALE, fineness)))
    return Stimulus(name, radius, (sphere(radius, GREEN if name == "marker" else RED, fineness=fineness),))


def _cube(radius: float) -> tuple[Part, ...]:
    """Blue, with a yellow lid and base.  A convex body's mean silhouette is a quarter of its surface:
    six faces of side s make 1.5 s² = π·radius²."""
    mesh = trimesh.creation.box([radius * np.sqrt(np.pi / 1.5)] * 3)
    is_lid = np.abs(mesh.face_normals[:, 2]) > 0.5
    blue, yellow = mesh.submesh([np.flatnonzero(~is_lid), np.flatnonzero(is_lid)], repair=False)
    return Part(blue, BLUE), Part(yellow, YELLOW)


# Scales the octopus's mean silhouette to a unit sphere's (tests/rendering/test_stimuli.py measures it).
_OCTOPUS_SCALE = 1.155


def _octopus(scale: float, fineness: int) -> list[Part]:
    """Return a toy octopus: a violet head facing x and eight orange arms below it."""
    head = transform(np.diag([0.56, 0.56, 0.64]), (0, 0, 0.36))
    parts = [Part(sphere(1.0, VIOLET, fineness=fineness).mesh.apply_transform(head), VIOLET)]
    for side in (-1, 1):
        parts.append(sphere(0.15, WHITE, (0.46, 0.22 * side, 0.52), fineness=max(fineness - 2, 0)))
        parts.append(sphere(0.085, BLACK, (0.56, 0.245 * side, 0.54), fineness=max(fineness - 2, 0)))
    t = np.linspace(0, 1, 12)
    for k in range(8):
        azimuth = np.deg2rad(45 * k + 22.5) + 0.45 * np.sin(np.pi * t * 1.4)
        reach = 0.22 + 0.95 * t
        height = -0.04 - 0.42 * np.sin(0.8 * np.pi * t) + 0.25 * t**3
        path = np.column_stack([reach * np.cos(azimuth), reach * np.sin(azimuth), height])
        parts.append(tube(path, 0.17 - 0.11 * t, ORANGE, sides_of(fineness)))
    return [Part(part.mesh.apply_scale(scale), part.color) for part in parts]


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

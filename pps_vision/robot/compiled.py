"""A chain's position and Jacobian, posture by posture, compiled by numba: of calls on arrays most of the time would go
into moving these about.

Compiled when first called, which takes seconds once; the code is then kept beside this file.
"""

from math import cos, sin

import numpy as np
from numba import njit

from pps_vision.types import Array

Vector = tuple[float, float, float]
_NOT = (0.0, 0.0, 0.0)


@njit(cache=True, error_model="numpy")
def positions(screws: Array, order: Array, point: Array, q: Array) -> tuple[Array, Array]:
    """Where a point (3,), known with the joints at zero, is at postures q (N, k), (N, 3), and its Jacobian (N, 3, k);
    `screws` (k, 6) are (v, ω), `order` (k,) from root to tip."""
    n, k = q.shape
    places, slopes = np.empty((n, 3)), np.empty((n, 3, k))
    for row in range(n):
        x, y, z = point[0], point[1], point[2]
        for at in range(k - 1, -1, -1):  # from the tip inwards: all that lies beyond a joint is carried by it
            i = order[at]
            vx, vy, vz, wx, wy, wz = screws[i]
            v, w, turn = (vx, vy, vz), (wx, wy, wz), _turn(q[row, i])
            x, y, z = _carried(v, w, turn, (x, y, z))
            for beyond in range(at + 1, k):
                j = order[beyond]
                turned = slopes[row, 0, j], slopes[row, 1, j], slopes[row, 2, j]
                slopes[row, 0, j], slopes[row, 1, j], slopes[row, 2, j] = _turned(_NOT, w, turn, turned)
            slopes[row, 0, i] = vx + wy * z - wz * y
            slopes[row, 1, i] = vy + wz * x - wx * z
            slopes[row, 2, i] = vz + wx * y - wy * x
        places[row, 0], places[row, 1], places[row, 2] = x, y, z
    return places, slopes


@njit(cache=True, error_model="numpy")
def pose(screws: Array, joints: Array, T_root_frame: Array, q: Array) -> Array:
    """(4, 4) where a frame, `T_root_frame` with the joints at zero, is at configuration q (n,); the `joints` (k,) of it
    that move the frame, from root to tip, have the `screws` (k, 6), (v, ω)."""
    T = T_root_frame.copy()
    for i in range(len(joints) - 1, -1, -1):
        v = screws[i, 0], screws[i, 1], screws[i, 2]
        w, turn = (screws[i, 3], screws[i, 4], screws[i, 5]), _turn(q[joints[i]])
        for column in range(4):
            one = T[0, column], T[1, column], T[2, column]
            one = _carried(v, w, turn, one) if column == 3 else _turned(_NOT, w, turn, one)
            T[0, column], T[1, column], T[2, column] = one
    return T


@njit(cache=True, error_model="numpy")
def _turn(angle: float) -> Vector:
    """Of an angle: sine, versine, and by how much the sine is less."""
    sine = sin(angle)
    return sine, 1 - cos(angle), angle - sine


@njit(cache=True, error_model="numpy")
def _carried(v: Vector, w: Vector, turn: Vector, point: Vector) -> Vector:
    """Where a joint of screw (v, ω) takes a point: around, along its axis by the screw's pitch, or straight on."""
    (x, y, z), beyond = _turned(v, w, turn, point), turn[2]
    if w[0] == 0 and w[1] == 0 and w[2] == 0:  # it slides
        return x + beyond * v[0], y + beyond * v[1], z + beyond * v[2]
    along = (w[0] * v[0] + w[1] * v[1] + w[2] * v[2]) * beyond
    return x + along * w[0], y + along * w[1], z + along * w[2]


@njit(cache=True, error_model="numpy")
def _turned(v: Vector, w: Vector, turn: Vector, point: Vector) -> Vector:
    """The same but for the way along the axis; with no v, of a direction."""
    (x, y, z), (wx, wy, wz), (sine, versine, _) = point, w, turn
    ux, uy, uz = v[0] + wy * z - wz * y, v[1] + wz * x - wx * z, v[2] + wx * y - wy * x
    return (
        x + sine * ux + versine * (wy * uz - wz * uy),
        y + sine * uy + versine * (wz * ux - wx * uz),
        z + sine * uz + versine * (wx * uy - wy * ux),
    )

"""A chain's position and Jacobian, posture by posture, compiled by numba: of calls on arrays most of the time would go
into moving these about.

Compiled when first called, which takes seconds once; the code is then kept beside this file.
"""

from math import cos, sin

import numpy as np
from numba import njit

from pps_vision.types import Array


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
            angle = q[row, i]
            sine, versine = sin(angle), 1 - cos(angle)
            ux, uy, uz = vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x
            along = (wx * vx + wy * vy + wz * vz) * (angle - sine)  # of a screw's pitch
            x += sine * ux + versine * (wy * uz - wz * uy) + along * wx
            y += sine * uy + versine * (wz * ux - wx * uz) + along * wy
            z += sine * uz + versine * (wx * uy - wy * ux) + along * wz
            if wx == 0 and wy == 0 and wz == 0:  # it slides
                x, y, z = x + (angle - sine) * vx, y + (angle - sine) * vy, z + (angle - sine) * vz
            for beyond in range(at + 1, k):
                j = order[beyond]
                a, b, c = slopes[row, 0, j], slopes[row, 1, j], slopes[row, 2, j]
                ux, uy, uz = wy * c - wz * b, wz * a - wx * c, wx * b - wy * a
                slopes[row, 0, j] = a + sine * ux + versine * (wy * uz - wz * uy)
                slopes[row, 1, j] = b + sine * uy + versine * (wz * ux - wx * uz)
                slopes[row, 2, j] = c + sine * uz + versine * (wx * uy - wy * ux)
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
        vx, vy, vz, wx, wy, wz = screws[i, 0], screws[i, 1], screws[i, 2], screws[i, 3], screws[i, 4], screws[i, 5]
        angle = q[joints[i]]
        sine, versine = sin(angle), 1 - cos(angle)
        slides = wx == 0 and wy == 0 and wz == 0
        along = angle if slides else (wx * vx + wy * vy + wz * vz) * (angle - sine)
        for column in range(4):
            x, y, z = T[0, column], T[1, column], T[2, column]
            ux, uy, uz = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
            if column == 3 and not slides:
                ux, uy, uz = ux + vx, uy + vy, uz + vz
            x += sine * ux + versine * (wy * uz - wz * uy)
            y += sine * uy + versine * (wz * ux - wx * uz)
            z += sine * uz + versine * (wx * uy - wy * ux)
            if column == 3:
                ax, ay, az = (vx, vy, vz) if slides else (wx, wy, wz)
                x, y, z = x + along * ax, y + along * ay, z + along * az
            T[0, column], T[1, column], T[2, column] = x, y, z
    return T

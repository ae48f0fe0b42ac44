"""Self-collision distances against surface points and closed-form distance functions of the bodies."""

import numpy as np
import pytest

from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.robot.icub import home, load_icub
from pps_vision.robot.model import Body
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.types import Array

ROBOT = load_icub()
SPACING_M = 0.004


def surface(body: Body) -> Array:
    """Points on the surface, at most about `SPACING_M` apart, edges included."""
    if body.shape == "sphere":
        (radius,) = body.size_m
        n = int(4 * np.pi * (radius / SPACING_M) ** 2)
        z, turn = 1 - (2 * np.arange(n) + 1) / n, np.pi * (1 + 5**0.5) * np.arange(n)
        across = np.sqrt(1 - z**2)
        return radius * np.column_stack([across * np.cos(turn), across * np.sin(turn), z])
    if body.shape == "cylinder":
        radius, length = body.size_m
        angle = np.linspace(0, 2 * np.pi, int(2 * np.pi * radius / SPACING_M) + 1)
        heights = np.linspace(-length / 2, length / 2, int(length / SPACING_M) + 2)
        rings = [(radius, z) for z in heights]
        rings += [(r, z) for r in np.arange(0, radius, SPACING_M) for z in heights[[0, -1]]]
        return np.vstack([np.column_stack([r * np.cos(angle), r * np.sin(angle), 0 * angle + z]) for r, z in rings])
    half = np.array(body.size_m) / 2
    grid = np.meshgrid(*(np.linspace(-h, h, int(2 * h / SPACING_M) + 2) for h in half), indexing="ij")
    points = np.stack(grid, axis=-1).reshape(-1, 3)
    return points[(np.abs(np.abs(points) - half) < 1e-12).any(axis=1)]


def signed_distance(body: Body, points: Array) -> Array:
    """Of points in the body's frame to its surface, negative inside."""
    if body.shape == "sphere":
        return np.linalg.norm(points, axis=1) - body.size_m[0]
    if body.shape == "cylinder":
        off = np.column_stack([np.hypot(points[:, 0], points[:, 1]), np.abs(points[:, 2])])
        off -= [body.size_m[0], body.size_m[1] / 2]
    else:
        off = np.abs(points) - np.array(body.size_m) / 2
    return np.linalg.norm(np.maximum(off, 0), axis=1) + np.minimum(off.max(axis=1), 0)


def compared(one: str, other: str) -> bool:
    """By the names of the frames: different limbs, and not an upper arm and the chest."""
    limbs = {name.split("_")[0] if name.startswith(("left_", "right_")) else "trunk" for name in (one, other)}
    return len(limbs) == 2 and not ("chest" in (one, other) and "upper_arm" in one + other)


def reference(q: Array, ignored: tuple[str, ...] = ()) -> float:
    """The smallest distance between surface points of a body and another body."""
    posture = ROBOT.at(q)
    bodies = [(body, posture.T_root(body.frame) @ body.T_frame_body) for body in ROBOT.bodies]
    bodies = [(body, T, surface(body)) for body, T in bodies if body.name not in ignored]
    return min(
        float(signed_distance(other, move_points(inverse(T_other) @ T_one, points)).min())
        for one, T_one, points in bodies
        for other, T_other, _ in bodies
        if compared(one.frame, other.frame)
    )


def crossed_arms() -> Array:
    """Forearms that swing inwards until they overlap."""
    q = home(ROBOT)
    q[ROBOT.indices(("left_shoulder_yaw", "right_shoulder_yaw"))] += np.deg2rad(60)
    q[ROBOT.indices(("left_elbow", "right_elbow"))] = np.deg2rad(80)
    return q


def test_distances_are_those_of_the_bodies_surfaces():
    rng, measured = np.random.default_rng(1), SelfCollision(ROBOT)
    postures = [home(ROBOT), *rng.uniform(ROBOT.lower_rad, ROBOT.upper_rad, (12, ROBOT.n_joints))]
    middle = home(ROBOT)
    postures += [middle + (crossed_arms() - middle) * share for share in (0.4, 0.6)]
    distances = np.array([measured.distance_m(q) for q in postures])
    expected = np.array([reference(q) for q in postures])
    apart = expected > 0
    assert apart.sum() >= 10
    assert np.all(expected[apart] >= distances[apart] - 1e-6), "no surface points are nearer"
    np.testing.assert_allclose(distances[apart], expected[apart], atol=1e-3)
    assert np.all(distances[~apart] < 0)


def test_crossed_forearms_overlap():
    assert SelfCollision(ROBOT).distance_m(crossed_arms()) < 0 < SelfCollision(ROBOT).distance_m(home(ROBOT))


@pytest.mark.parametrize("roll_deg", [0.0, 45.0])
def test_adjacent_bodies_are_not_compared(roll_deg: float):
    """An arm that hangs down is near the chest by construction, not by collision."""
    q = np.zeros(ROBOT.n_joints)
    q[ROBOT.indices(("left_shoulder_roll", "right_shoulder_roll"))] = np.deg2rad(roll_deg)
    assert SelfCollision(ROBOT).distance_m(q) == pytest.approx(reference(q), abs=1e-3)


def test_ignored_bodies_do_not_count():
    """Postures in which nothing is as near as the right index finger."""
    rng, finger = np.random.default_rng(2), ("right_palm_4",)
    every, without = SelfCollision(ROBOT), SelfCollision(ROBOT, finger)
    postures = rng.uniform(ROBOT.lower_rad, ROBOT.upper_rad, (1500, ROBOT.n_joints))
    nearer = [q for q in postures if every.distance_m(q) < without.distance_m(q) - 1e-4 and every.distance_m(q) > 0]
    assert len(nearer) >= 3
    for q in nearer[:3]:
        assert without.distance_m(q) == pytest.approx(reference(q, finger), abs=1e-3)

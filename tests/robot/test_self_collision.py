"""Self-collision distances against surface points and closed-form distance functions of the bodies."""

import numpy as np

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
        z = 1 - (2 * np.arange(n) + 1) / n
        turn = np.pi * (1 + 5**0.5) * np.arange(n)
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


def compared(first: str, second: str) -> bool:
    """By the names of the frames: different limbs, and not an upper arm and the chest."""
    limbs = {name.split("_")[0] if name.startswith(("left_", "right_")) else "trunk" for name in (first, second)}
    return len(limbs) == 2 and not ("chest" in (first, second) and "upper_arm" in first + second)


def reference(q: Array, ignored: tuple[str, ...] = ()) -> float:
    """The smallest distance between surface points of a body and another body."""
    posture = ROBOT.at(q)
    bodies = [(body, posture.T_root(body.frame) @ body.T_frame_body) for body in ROBOT.bodies]
    bodies = [(body, T, surface(body)) for body, T in bodies if body.name not in ignored]
    return min(
        float(signed_distance(second, move_points(inverse(T_other) @ T_one, points)).min())
        for first, T_one, points in bodies
        for second, T_other, _ in bodies
        if compared(first.frame, second.frame)
    )


def test_rates_of_distances_are_their_differences():
    rng = np.random.default_rng(11)
    bodies = SelfCollision(ROBOT)
    h = 5e-4
    compared = 0
    joints = list(range(ROBOT.n_joints))
    for _ in range(40):
        q = rng.uniform(ROBOT.lower_rad, ROBOT.upper_rad)
        dq = rng.normal(size=ROBOT.n_joints)
        distance, rates = bodies.parting(q, 0.1, joints)
        every = _distances(bodies, q)
        np.testing.assert_allclose(np.sort(distance), np.sort(every[every < 0.1]), atol=1e-6)
        distance_before, after = (bodies.parting(q + step * dq, 0.1, joints)[0] for step in (-h, h))
        if len(distance_before) == len(after) == len(distance) and np.all(distance > 0.005):
            np.testing.assert_allclose((after - distance_before) / (2 * h), rates @ dq, atol=0.005)
            compared += len(distance)
    assert compared > 20


def crossed_arms() -> Array:
    """Forearms that swing inwards until they overlap."""
    q = home(ROBOT)
    q[ROBOT.indices(("left_shoulder_yaw", "right_shoulder_yaw"))] += np.deg2rad(60)
    q[ROBOT.indices(("left_elbow", "right_elbow"))] = np.deg2rad(80)
    return q


def test_distances_are_those_of_the_bodies_surfaces():
    rng = np.random.default_rng(1)
    measured = SelfCollision(ROBOT)
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


def test_the_clear_share_of_a_motion_is_never_more_than_is_clear():
    """Random motions of arms and torso, from postures that are near themselves or not, at 200 points each."""
    rng = np.random.default_rng(4)
    bodies = SelfCollision(ROBOT)
    shares = []
    for k in range(150):
        q = rng.uniform(ROBOT.lower_rad, ROBOT.upper_rad)
        start = bodies.distance_m(q)
        if start <= 0 or (k % 2 and start > 0.03):
            continue
        change = rng.standard_normal(ROBOT.n_joints) * rng.choice([0.01, 0.1, 0.4]) * (rng.random(ROBOT.n_joints) < 0.4)
        share = bodies.clear_share(q, change, 0.02)
        way = [bodies.distance_m(q + s * share * change) for s in np.linspace(0, 1, 200)]
        assert min(way) >= min(start, 0.02) - 2e-6
        shares.append(share)
    assert len(shares) > 60
    assert np.mean(np.array(shares) == 1.0) > 0.4


def test_a_motion_past_a_body_is_not_judged_by_its_ends():
    """The left arm swings past the trunk: far enough at both ends, too near between."""
    bodies = SelfCollision(ROBOT)
    q = home(ROBOT)
    change = np.zeros(ROBOT.n_joints)
    q[ROBOT.indices(ROBOT.names.arm("left"))] = np.deg2rad([-65, 2, 4, 44, -50, -3, 25])
    change[ROBOT.indices(("left_shoulder_pitch",))] = np.deg2rad(80)
    distances = np.array([bodies.distance_m(q + s * change) for s in np.linspace(0, 1, 101)])
    assert distances.min() < 0.02 < min(distances[0], distances[-1])
    clear = int(np.argmax(distances < 0.02))
    assert 0.5 * clear < 100 * bodies.clear_share(q, change, 0.02) < clear


def test_from_a_start_too_near_no_two_bodies_come_nearer_and_most_ways_out_are_clear():
    """Random postures that are too near or overlap; along the steepest way out of the nearest two bodies, and at
    random."""
    rng = np.random.default_rng(7)
    bodies = SelfCollision(ROBOT)
    out = []
    moved = 0
    while len(out) < 30:
        q = rng.uniform(ROBOT.lower_rad, ROBOT.upper_rad)
        start = bodies.distance_m(q)
        if start >= 0.019:
            continue
        steps = 1e-4 * np.eye(ROBOT.n_joints)
        gradient = np.array([bodies.distance_m(q + step) - bodies.distance_m(q - step) for step in steps])
        for change in (0.1 * gradient / np.abs(gradient).max(), 0.1 * rng.standard_normal(ROBOT.n_joints)):
            share = bodies.clear_share(q, change, 0.02)
            way = np.array([_distances(bodies, q + s * share * change) for s in np.linspace(0, 1, 60)])
            assert np.all(way >= np.minimum(way[0], 0.02) - 1e-5)
            moved += share > 0
        out.append(bodies.clear_share(q, 0.1 * gradient / np.abs(gradient).max(), 0.02) > 0)
    assert np.mean(out) > 0.5
    assert moved > np.sum(out)
    assert all(bodies._distances.activeCollisionPairs)


def _distances(bodies: SelfCollision, q: Array) -> Array:
    """Of all pairs."""
    bodies.distance_m(q)
    return np.array([result.min_distance for result in bodies._distances.distanceResults])


def test_what_moves_no_body_is_clear_and_what_overlaps_is_not():
    bodies = SelfCollision(ROBOT)
    head = np.zeros(ROBOT.n_joints)
    head[ROBOT.indices(ROBOT.names.gaze_joints)] = 1.0
    assert bodies.clear_share(crossed_arms(), head, 0.02) == 1.0
    assert bodies.clear_share(crossed_arms(), np.full(ROBOT.n_joints, 0.01), 0.02) == 0.0
    for tiny in (1e-300, 1e-170, 1e-14):  # whose squares underflow
        assert bodies.clear_share(home(ROBOT), np.full(ROBOT.n_joints, tiny), 0.02) == 1.0
    assert {name for name, moves in zip(ROBOT.joint_names, bodies.moving, strict=True) if not moves} == {
        *ROBOT.names.gaze_joints,
        "neck_roll",
    }

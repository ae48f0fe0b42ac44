"""The arm in closed form against forward kinematics, iterative search and a general minimiser."""

import numpy as np
import pytest
from data import SEED
from scipy.optimize import minimize

from pps_vision.experiments.baselines.spherical_arm import SphericalArm
from pps_vision.robot.icub import load_icub
from pps_vision.robot.inverse_kinematics import solve_ik

ROBOT = load_icub()
LOWER, UPPER = np.deg2rad([-95, 0, -20, 15]), np.deg2rad([10, 160, 80, 105])  # J's
CHAINS = {side: ROBOT.chain(ROBOT.names.arm(side)[:4], f"{side}_palm") for side in ("left", "right")}


def palm(side, q):
    """By Pinocchio, not by the chain the solver was made from."""
    full = np.zeros(ROBOT.n_joints)
    full[ROBOT.indices(ROBOT.names.arm(side)[:4])] = q
    return ROBOT.at(full).point(f"{side}_palm")


@pytest.fixture
def rng():
    return np.random.default_rng(SEED)


@pytest.fixture(params=["left", "right"])
def side(request):
    return request.param


@pytest.fixture
def arm(side):
    return SphericalArm.of(CHAINS[side], LOWER, UPPER)


def test_positions_of_random_postures_are_reached(arm, side, rng):
    points = np.array([palm(side, q) for q in rng.uniform(LOWER, UPPER, (300, 4))])
    q = arm.solve(points)
    assert np.isfinite(q).all()
    assert (q >= LOWER).all()
    assert (q <= UPPER).all()
    again = np.array([palm(side, one) for one in q])
    np.testing.assert_allclose(again, points, atol=1e-9)


def test_unreachable_points_are_not_found_by_least_squares(arm, side, rng):
    """Points anywhere about the shoulder: a posture that is found gets there, and where none is, descent from sixteen
    starts stops short."""
    points = arm.shoulder + rng.uniform(-0.4, 0.4, (400, 3))
    q = arm.solve(points)
    denied = np.isnan(q[:, 0])
    assert 0.3 < denied.mean() < 0.95
    np.testing.assert_allclose([palm(side, one) for one in q[~denied]], points[~denied], atol=1e-9)
    starts = rng.uniform(LOWER, UPPER, (16, int(denied.sum()), 4))
    searched = solve_ik(CHAINS[side].positions, points[denied], starts, LOWER, UPPER)
    assert not searched.converged.any()


def test_joints_at_their_limits(arm, side, rng):
    """Postures with one or more joints at a limit, where rounding decides."""
    q = rng.uniform(LOWER, UPPER, (300, 4))
    at = rng.random((300, 4)) < 0.4
    q = np.where(at, np.where(rng.random((300, 4)) < 0.5, LOWER, UPPER), q)
    points = np.array([palm(side, one) for one in q])
    assert np.isfinite(arm.solve(points)).all()


def test_least_effort_is_never_beaten(arm, side, rng):
    """SLSQP from several starts finds no posture that reaches the point nearer to the middle of the ranges."""
    points = np.array([palm(side, q) for q in rng.uniform(LOWER, UPPER, (4, 4))])
    q, effort = arm.least_effort(points)
    middle, half = (UPPER + LOWER) / 2, (UPPER - LOWER) / 2

    def off(z, point):
        x, J = CHAINS[side].positions((middle + half * z)[None])
        return 100 * (x[0] - point), 100 * J[0] * half

    for point, mine, m in zip(points, q, effort, strict=True):
        np.testing.assert_allclose(palm(side, mine), point, atol=1e-9)
        assert m == pytest.approx(np.mean(((mine - middle) / half) ** 2))
        best = np.inf
        for start in rng.uniform(-1, 1, (3, 4)):
            found = minimize(
                lambda z: np.mean(z**2),
                start,
                jac=lambda z: z / 2,
                bounds=[(-1, 1)] * 4,
                constraints={
                    "type": "eq",
                    "fun": lambda z, p=point: off(z, p)[0],
                    "jac": lambda z, p=point: off(z, p)[1],
                },
                options={"maxiter": 40, "ftol": 1e-8},
            )
            if np.linalg.norm(palm(side, middle + half * np.clip(found.x, -1, 1)) - point) < 1e-6:
                best = min(best, float(np.mean(np.clip(found.x, -1, 1) ** 2)))
        assert m <= best + 1e-4
    assert arm.solve(np.zeros((0, 3))).shape == (0, 4)
    far, none = arm.least_effort(points + np.array([2.0, 0, 0]))
    assert np.isnan(far).all()
    assert np.isnan(none).all()


def test_arms_of_other_geometry_are_refused(arm):
    with pytest.raises(ValueError, match="four joints"):
        SphericalArm.of(ROBOT.chain(ROBOT.names.arm("left")[:3], "left_palm"), LOWER, UPPER)
    with pytest.raises(ValueError, match="spherical shoulder"):
        SphericalArm.of(ROBOT.chain(ROBOT.names.arm("left")[1:5], "left_palm"), LOWER, UPPER)
    with pytest.raises(ValueError, match=r"\(N, 3\)"):
        arm.solve(np.zeros(3))

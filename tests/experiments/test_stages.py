"""The stages' methods on input with an independent truth: drawn squares, straight paths, thrown balls, ray casting."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from data import SEED

from control.arm import ArmParams
from pps_vision.experiments.films.recordings import FPS, Footage
from pps_vision.experiments.stages import Stages, arm, filter, points, stereo, trigger
from pps_vision.experiments.stages.arm import Task, damped_least_squares
from pps_vision.experiments.stages.filter import Measurements
from pps_vision.experiments.stages.image_tracker import DEFAULT, BoxedFilm
from pps_vision.experiments.stages.image_tracker import methods as image_trackers
from pps_vision.experiments.study import Method, rms
from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.icub import HOME_ARM_RAD, LEFT_EYE, home, load_icub
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.types import StereoFrame
from tracking import kalman

pytestmark = pytest.mark.long
RIG = StereoRig.fixed(LEFT_EYE, LEFT_EYE, np.eye(4))


def moving_square(px_per_frame: int, seed: int) -> Footage:
    """A textured square, 24 px wide, that starts to move to the right before a textured wall, equal in both eyes."""
    rng = np.random.default_rng(seed)
    wall = cv2.blur(rng.uniform(60, 180, (240, 320, 3)), (3, 3))
    square = rng.uniform(200, 250, (24, 24, 3)) * (1.0, 0.9, 0.2)
    frames = []
    position = []
    for k in range(trigger.STARTS + trigger.AFTER):
        x = 150 + px_per_frame * max(k - trigger.STARTS + 1, 0)
        image = wall.copy()
        image[98:122, x - 12 : x + 12] = square
        noisy = np.clip(image + rng.normal(0, 1, image.shape), 0, 255).astype(np.uint8)
        frames.append(StereoFrame(noisy, noisy, k / FPS, k / FPS, None, None))
        view = RIG.view_of(frames[-1]).left
        position.append(view.center + view.rays(np.array([x - 0.5, 109.5])))
    velocity = np.diff(np.array(position), axis=0, prepend=[position[0]]) * FPS
    boxes = ((None, None),) * len(frames)
    radius_m = 12 / LEFT_EYE.focal_px
    visible = np.ones(len(frames), bool)
    return Footage(tuple(frames), np.array(position), velocity, visible, boxes, radius_m, RIG, None)


@pytest.fixture(scope="module")
def triggers() -> dict[str, Method]:
    return trigger.methods(moving_square(0, 4))


@pytest.mark.parametrize("name", [trigger.DEFAULT, "LK residual grid (R)", "difference, warped"])
def test_triggers_detect_the_start_of_a_motion_and_nothing_before(name, triggers):
    values = triggers[name](moving_square(5, 5), 0)
    assert max(values["delay"]) <= 3
    assert len(values["ms"]) == 2 * (trigger.STARTS + trigger.AFTER)
    quiet = triggers[name](moving_square(0, 4), 0)
    assert not np.any(quiet["alarm"])
    assert len(quiet["alarm"]) == 2 * trigger.AFTER


def test_image_trackers_on_a_square_that_jumps():
    """The marker blob searches everywhere; KCF only nearby."""
    rng = np.random.default_rng(0)
    images = []
    boxes = []
    for k in range(12):
        image = rng.integers(100, 140, (120, 160, 3), dtype=np.uint8)
        x, y = (20 + 2 * k, 30) if k < 6 else (110, 70 - 2 * k)
        image[y : y + 20, x : x + 20] = (230, 20, 20)
        images.append(image)
        boxes.append((float(x), float(y), 20.0, 20.0))
    film = BoxedFilm(tuple(images), tuple(boxes), hue_deg=0.0)
    blob, kcf, particles = (image_trackers()[name](film, 0) for name in ("marker blob", "KCF", DEFAULT))
    assert np.mean(blob["iou"]) == pytest.approx(10 / 11 * np.pi / 4, abs=0.03)  # of the disc of equal area
    assert np.mean(kcf["iou"] > 0) < 0.7
    assert np.all(particles["iou"][:5] > 0)


def test_triangulation_is_nearer_to_a_textured_ball_than_disparity():
    pairs = stereo._pairs("textured ball", "rendered", SEED)
    assert len(pairs) > 10
    values = {name: method(pairs, SEED) for name, method in stereo.methods().items()}
    assert all(len(value["error_mm"]) > 0.9 * len(value["ms"]) for value in values.values())
    error_mm = {name: rms(np.asarray(value["error_mm"])) for name, value in values.items()}
    assert error_mm[stereo.OURS] < 1.5
    assert error_mm[stereo.OURS] < error_mm["whole BM"] < 15
    for triangulation in ("midpoint", "linear (OpenCV)"):
        assert error_mm[triangulation] == pytest.approx(error_mm[stereo.OURS], rel=0.3)


STD = np.array([1e-4, 1e-4, 3e-4])


def approach(seed: int, noise: float = 1.0) -> Measurements:
    """2 s at 10 cm/s towards the origin, which the surface (radius 3 cm) touches at the end."""
    rng = np.random.default_rng(seed)
    stamps = 0.05 * np.arange(41)
    velocity = np.array([-0.08, 0.06, 0.0])
    path = -velocity * (2.0 - stamps)[:, None] + 0.03 * np.array([0.8, -0.6, 0.0])
    return Measurements(
        stamps_s=stamps,
        positions=path + noise * STD * rng.standard_normal((41, 3)),
        covs=np.tile(np.diag(STD**2), (41, 1, 1)),
        path=path,
        distance_m=0.4,
        counts=np.arange(41) >= 10,
    )


def test_without_adaptation_both_filters_agree():
    data = approach(5)
    params = replace(data.params(), adaptation_rate=0)
    belief = data.first(params)
    for (stamp_s, position, cov), state in zip(data.later(), filter.opencv_states(data)[1:], strict=True):
        belief = kalman.update(params, kalman.predict(params, belief, stamp_s), position, cov)
        np.testing.assert_allclose(state, belief.mean, atol=1e-9)


def test_the_quadratic_programme_keeps_limits_alone_and_least_squares_only_behind_the_last_stage():
    numbers = arm.run(Stages(seed=SEED, n_movements=4))
    for scenario, cells in numbers["cells"].items():
        ours = cells[arm.OURS]
        assert ours["violating_percent"][0] == ours["touching_percent"][0] == 0
        assert (cells["damped least squares"]["violating_percent"][0] > 0) == (scenario == "alone")
        assert 0 < ours["error_cm_s"][0] < 12


ROBOT = load_icub()
BODIES = SelfCollision(ROBOT)
POINT = np.array([-0.02, -0.05, 0.01])
REST = np.array(HOME_ARM_RAD)
ARM = ROBOT.indices(ROBOT.names.arm("left"))


def test_with_little_damping_the_point_moves_as_asked_and_the_rest_goes_home():
    q = home(ROBOT)
    velocity = 0.01 * np.random.default_rng(SEED).normal(size=3)
    q[ARM[5:]] += 0.1  # the wrist, which the forearm's point leaves free
    task = Task(ROBOT, BODIES, "left", "left_forearm", POINT, q, velocity)
    dq = damped_least_squares(ROBOT.at(q), task, damping_m=1e-4)
    J = ROBOT.at(q).jacobian("left_forearm", POINT)[:3]
    np.testing.assert_allclose(J @ dq, velocity, atol=1e-6)
    np.testing.assert_allclose(dq[ARM[5:]], -0.1 * ArmParams().posture_per_s, atol=1e-6)
    assert not np.any(np.delete(dq, ARM))


def test_rates_are_finite_at_a_singular_posture_and_clipped_at_the_limits():
    q = home(ROBOT)
    q[ARM] = np.where(np.arange(7) == 3, ROBOT.lower_rad[ARM], 0.0)
    outwards = 10 * (ROBOT.at(q).point("left_forearm", POINT) - ROBOT.at(q).point("left_upper_arm"))
    task = Task(ROBOT, BODIES, "left", "left_forearm", POINT, q, outwards)
    for hold_s, stays in ((None, False), (0.5, True)):
        dq = damped_least_squares(ROBOT.at(q), task, hold_s, REST - 1.0)
        assert np.abs(dq).max() <= ArmParams().max_rate_rad_s + 1e-9
        end = q + 0.5 * dq
        assert np.array_equal(ROBOT.clamp(end), end) == stays


def test_points_are_nearer_than_by_a_median_filter_and_their_ellipsoids_hold():
    measured = points.methods()
    path = points.simulated("outliers", 3)
    smoothed, median = (measured[name](path, 0) for name in (points.DEFAULT, "median of 5"))
    assert np.median(smoothed["error_mm"]) < 0.6 * np.median(median["error_mm"])
    assert 0.85 < np.mean(smoothed["inside"]) <= 1

"""Flow of regions on drawn images whose motion is known, the velocity that it starts a track with, and warping between
poses against the projection of points.
"""

import cv2
import numpy as np
import pytest
from ball_scenes import Sphere, frame

from pps_vision.geometry.camera import Camera, StereoRig, View
from pps_vision.geometry.se3 import transform
from pps_vision.robot.icub import LEFT_EYE, home, set_gaze
from pps_vision.robot.model import Robot
from pps_vision.types import Array
from tracking.camera_pose import EgoMotion
from tracking.motion_trigger import Flow2D, GreyImage, Match, TriggerParams, match, velocity
from tracking.tracker import Tracker, TrackerParams

VIEW = View(LEFT_EYE, transform())
DT = 0.05
BOX = (150, 110, 30, 30)
P = np.array([-0.45, 0.02, 0.35])
"""In sight of both eyes, m."""
V = np.array([0.0, 0.25, -0.15])
"""Across the view, m/s."""


def texture(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    return cv2.GaussianBlur(rng.uniform(0, 255, shape), (0, 0), 1.5).astype(np.uint8)


def pair(rng: np.random.Generator, object_px: tuple[int, int], wall_px: tuple[int, int] = (0, 0)) -> list[np.ndarray]:
    """A textured square before a textured wall, then both moved by whole pixels so that the square fills BOX."""
    wall = texture(rng, (240, 320))
    square = texture(rng, (30, 30))
    images = [wall, np.roll(wall, wall_px[::-1], (0, 1))]
    x, y = BOX[:2]
    for image, (dx, dy) in zip(images, (object_px, (0, 0)), strict=True):
        image[y - dy : y - dy + 30, x - dx : x - dx + 30] = square
    return images


def measured(
    images: list[np.ndarray], older: View = VIEW, tolerance_px: float = 1.0, part: tuple[slice, slice] = np.s_[:, :]
) -> Match:
    """Flow of a part of BOX."""
    mask = np.zeros((30, 30), bool)
    mask[part] = True
    old = GreyImage(images[0], older, 1.0)
    new = GreyImage(images[1], VIEW, 1.0 + DT)
    return match(EgoMotion(LEFT_EYE), old, new, 1.2, tolerance_px, [(BOX, mask)])[0]


@pytest.mark.parametrize("moved", [(3, -2), (-5, 1), (1, -1)])
def test_flow_of_a_region_is_its_motion(rng, moved):
    result = measured(pair(rng, moved))
    assert result.moving > 0.7
    np.testing.assert_allclose(result.flow.velocity_px_s * DT, moved, atol=0.1)
    np.testing.assert_allclose(result.flow.now_px - result.flow.then_px, moved, atol=0.1)
    assert np.abs(result.flow.now_px - (164.5, 124.5)).max() < 4
    std_px = np.sqrt(np.linalg.eigvalsh(result.flow.cov)) * DT
    assert std_px.min() >= 0.1
    assert std_px.max() < 0.3
    small = measured(pair(rng, moved), part=np.s_[13:16, 13:16])
    np.testing.assert_allclose(small.flow.velocity_px_s * DT, moved, atol=0.2)


def test_what_comes_along_the_line_of_sight_moves_although_its_flow_has_no_direction(rng):
    """The square grows by a fifth about its centre: points at its rim move by 2.5 px, in all directions."""
    images = pair(rng, (0, 0))
    place = np.s_[110:140, 150:180]
    grow = np.array([[1.2, 0, -0.2 * 14.5], [0, 1.2, -0.2 * 14.5]])
    images[1][place] = cv2.warpAffine(images[0][place], grow, (30, 30))
    result = measured(images)
    assert result.moving >= 0.5
    assert np.abs(result.flow.velocity_px_s * DT).max() < 1.0  # on average over the square it does not move


def test_what_moves_with_its_surroundings_does_not_move(rng):
    result = measured(pair(rng, (2, 1), (2, 1)))
    assert result.moving == 0
    assert result.unmatched < 0.2
    relative = measured(pair(rng, (5, 1), (2, 1))).flow
    np.testing.assert_allclose(relative.velocity_px_s * DT, (3, 0), atol=0.15)


def test_little_motion_is_none(rng):
    images = pair(rng, (0, 0))
    place = np.s_[110:140, 150:180]
    images[1][place] = cv2.warpAffine(images[0], np.array([[1, 0, 0.3], [0, 1, 0]]), (320, 240))[place]
    assert measured(images).moving == 0
    assert measured(images, tolerance_px=0.15).moving > 0.5
    images[1][place] = texture(rng, (30, 30))  # new texture has no match
    result = measured(images)
    assert result.unmatched > 0.75
    assert result.moving < 0.25


def test_the_eyes_own_motion_is_no_flow_but_part_of_the_way(rng):
    turned = View(LEFT_EYE, transform(rotation=cv2.Rodrigues(np.array([0.0, 0.02, 0.0]))[0]))
    for moved_px in (0, 4):
        old, new = pair(rng, (moved_px, 0))
        older = EgoMotion(LEFT_EYE).warp(old, VIEW, turned, 0.0)  # the same scene, far away, from the older pose
        result = measured([older, new], turned)
        assert (result.moving > 0) == (moved_px > 0)
        assert result.unmatched < 0.2
    np.testing.assert_allclose(result.flow.velocity_px_s * DT, (4, 0), atol=0.2)
    way = turned.project(VIEW.center + 100 * VIEW.rays(result.flow.now_px - (4, 0)))
    np.testing.assert_allclose(result.flow.then_px, way, atol=0.2)


def flows_of(
    rig: StereoRig,
    robot: Robot,
    v: Array = V,
    std_px: float = 0.1,
    interval_s: float = DT,
    rng: np.random.Generator | None = None,
) -> tuple[Flow2D, Flow2D]:
    """Exact flow of P, while the head turns; with a generator, the older places err by `std_px`."""
    current = rig.view(home(robot))
    older = rig.view(set_gaze(robot, home(robot), yaw=0.02, pitch=0.01))
    cov = (std_px / interval_s) ** 2 * np.eye(2)
    shifts = std_px * rng.standard_normal((2, 2)) if rng else np.zeros((2, 2))
    left, right = (
        Flow2D(np.zeros(2), cov, b.project(P), a.project(P - v * interval_s) + shift, a, interval_s)
        for a, b, shift in ((older.left, current.left, shifts[0]), (older.right, current.right, shifts[1]))
    )
    return left, right


def test_velocity_across_the_view_follows_from_flow(rig, robot, view):
    flows = flows_of(rig, robot)
    across = []
    for subset in (flows, (flows[0], None), (None, flows[1])):
        mean, cov = velocity(subset, view, P, (0.3, 0.0))
        np.testing.assert_allclose(mean[1:], V[1:], atol=0.02)
        assert abs(mean[0]) < 0.05
        assert 0.25 < np.sqrt(cov[0, 0]) <= 0.3
        across.append(np.linalg.eigvalsh(cov)[0])
    assert across[0] == pytest.approx(0.5 * across[1], rel=0.15)
    assert velocity((None, None), view, P, (0.3, 0.0)) is None


def test_the_covariance_of_the_velocity_by_sampling(rig, robot, view, rng):
    errors = []
    for v in 0.1 * rng.standard_normal((500, 3)):
        mean, cov = velocity(flows_of(rig, robot, v, 0.3, rng=rng), view, P, (0.1, 0.0))
        errors.append(mean - v)
    whitened = np.array(errors) @ np.linalg.cholesky(np.linalg.inv(cov))
    np.testing.assert_allclose(np.cov(whitened.T), np.eye(3), atol=0.25)


def test_a_track_begins_with_the_velocity_of_its_flow(rig, robot, view):
    ahead = view.left.T_root_camera
    v = ahead[:3, :3] @ np.array([0.28, 0, 0])
    tracks = {}
    for flow in (True, False):
        rng = np.random.default_rng(3)
        params = TrackerParams(confirm_frames=1, trigger=TriggerParams(flow=flow))
        tracker = Tracker(params, rig, np.random.default_rng(1))
        for k in range(8):
            center = (ahead @ np.array([0.014 * max(k - 5, 0), 0.0, 0.5, 1.0]))[:3]
            track = tracker.step(frame(rig, home(robot), [Sphere(center, 0.03, (210, 45, 40))], DT * k, rng)).track
            if track.is_known:
                tracks.setdefault(flow, track)
    assert np.linalg.norm(tracks[False].velocity - v) > 0.2
    error = tracks[True].velocity - v
    assert np.linalg.norm(error) < 0.06
    assert error @ np.linalg.inv(tracks[True].cov[3:6, 3:6]) @ error < 16


LENS = Camera(173, 131, 150.0, 152.0, 84.0, 66.0, (-0.3, 0.09, 0.001, -0.0005, 0.0))
THEN = View(LENS, transform(cv2.Rodrigues(np.array([0.1, -0.2, 0.05]))[0], (0.1, 0.2, 0.3)))
NOW = View(LENS, transform(cv2.Rodrigues(np.array([0.13, -0.17, 0.02]))[0], (0.11, 0.18, 0.31)))


def exact(inverse_distance: float) -> Array:
    """(h, w, 2) where `THEN` saw the points at that distance along the lines of sight of `NOW`; NaN: nowhere."""
    v, u = np.mgrid[: LENS.height, : LENS.width]
    rays = NOW.rays(np.column_stack([u.ravel(), v.ravel()]).astype(float))
    points = rays * 1e9 if inverse_distance == 0 else NOW.center + rays / inverse_distance
    return np.asarray(THEN.project(points)).reshape(LENS.height, LENS.width, 2)


@pytest.mark.parametrize("inverse_distance", [0.0, 0.5, 2.0])
def test_each_pixel_is_where_the_older_image_showed_it(inverse_distance):
    maps = EgoMotion(LENS).maps(THEN, NOW, inverse_distance)
    expected = exact(inverse_distance)
    off = np.linalg.norm(maps - expected, axis=-1)
    assert np.nanmax(off) < 0.05
    assert maps.shape == (LENS.height, LENS.width, 2)


def test_a_warped_image_shows_what_the_older_one_showed_there():
    """A smooth image, whose brightness at a place is known between pixels as well."""

    def level(px: Array) -> Array:
        return np.asarray(120 + 60 * np.sin(px[..., 0] / 20) + 40 * np.cos(px[..., 1] / 15))

    v, u = np.mgrid[: LENS.height, : LENS.width]
    image = np.rint(level(np.stack([u, v], axis=-1))).astype(np.uint8)
    warped = EgoMotion(LENS).warp(image, THEN, NOW, 0.5)
    expected = exact(0.5)
    inside = ((expected > 1) & (expected < [LENS.width - 2, LENS.height - 2])).all(axis=-1)
    assert inside.mean() > 0.5
    assert np.abs(warped - level(expected))[inside].max() < 1.5
    outside = ((expected < -2) | (expected > [LENS.width + 1, LENS.height + 1])).any(axis=-1)
    assert outside.any()
    assert not warped[outside].any()
    box = (40, 30, 90, 77)
    assert np.array_equal(EgoMotion(LENS).warp(image, THEN, NOW, 0.5, box), warped[30:77, 40:90])

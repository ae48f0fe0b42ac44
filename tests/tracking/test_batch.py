"""The marker in batches of images: where the rays put it, and the same path as frame by frame."""

import numpy as np
import pytest
import torch
from raycast import Sphere, frame, look

from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.icub import home
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Image
from tracking.batch import MarkerBatch
from tracking.marker import MarkerParams, find_markers
from tracking.outline import Optics
from tracking.tracker import Tracker, TrackerParams

GREEN = (15.0, 200.0, 40.0)


def _balls(rig: StereoRig, robot: Robot, rng: np.random.Generator, n: int) -> tuple[list[Image], Array]:
    """Images of green balls of 4 to 44 px, and where their centres are in them (n, 2)."""
    view = rig.view(home(robot)).left
    images, centers = [], []
    for k in range(n):
        pixel = np.array([rng.uniform(60, 260), rng.uniform(60, 180)])
        p = view.center + rng.uniform(0.3, 0.7) * view.rays(pixel)
        images.append(look(view, [Sphere(p, 0.004 + 0.002 * k, GREEN)], rng))
        centers.append(view.project(p))
    return images, np.array(centers)


def test_centres_are_where_the_rays_meet_the_image(rig: StereoRig, robot: Robot, rng: np.random.Generator) -> None:
    images, centers = _balls(rig, robot, rng, 10)
    optics, params = Optics(rig.left), MarkerParams()
    found = MarkerBatch(params, optics, "cpu").find(np.stack(images))
    for shape, center, image in zip(found, centers, images, strict=True):
        assert shape is not None
        assert np.linalg.norm(shape.center_px - center) < 0.2
        alone = find_markers(params, image, optics)[0]
        assert np.allclose(shape.center_px, alone.center_px, atol=0.02)
        assert shape.angular_radius_rad == pytest.approx(alone.angular_radius_rad, rel=0.01)
        assert np.allclose(shape.cov_px, alone.cov_px, rtol=0.3, atol=1e-4)


def test_what_is_no_disc_alone_is_seen_as_frame_by_frame(
    rig: StereoRig, robot: Robot, rng: np.random.Generator
) -> None:
    view = rig.view(home(robot)).left
    cut = Sphere(view.center + 0.3 * view.rays([4.0, 120.0]), 0.015, GREEN)
    huge = Sphere(view.center + 0.3 * view.rays([160.0, 120.0]), 0.08, GREEN)
    images = np.stack([look(view, [one] if one else [], rng) for one in (cut, None, huge)])
    optics, params = Optics(rig.left), MarkerParams()
    found = MarkerBatch(params, optics, "cpu").find(images)
    assert found[1] is None
    for k in (0, 2):
        shape, alone = found[k], find_markers(params, images[k], optics)[0]
        assert shape is not None
        assert np.array_equal(shape.center_px, alone.center_px)


def test_the_path_is_the_one_of_frame_by_frame(rig: StereoRig, robot: Robot, rng: np.random.Generator) -> None:
    """Within 0.1 mm, and both where the ball is within 1 mm."""
    q, frames, path = home(robot), [], []
    middle = rig.view(q).left.center + 0.4 * rig.view(q).left.rays([150.0, 120.0])
    for k in range(8):
        path.append(middle + 0.03 * np.array([0.2 * np.sin(0.5 * k), np.cos(0.5 * k), np.sin(0.5 * k)]))
        frames.append(frame(rig, q, [Sphere(path[-1], 0.01, GREEN)], 0.05 * k, rng))
    eyes = [MarkerBatch(MarkerParams(), Optics(camera), "cpu") for camera in (rig.left, rig.right)]
    left, right = (
        eye.find(np.stack([getattr(f, side) for f in frames]))
        for eye, side in zip(eyes, ("left", "right"), strict=True)
    )
    alone, batched = (Tracker(TrackerParams(mode="marker"), rig, np.random.default_rng(0)) for _ in range(2))
    for f, p, *shapes in zip(frames, path, left, right, strict=True):
        one, other = alone.step(f).track, batched.step(f, (shapes[0], shapes[1])).track
        assert one.status == other.status
        if one.is_known:
            assert np.linalg.norm(one.position - other.position) < 1e-4
            assert np.linalg.norm(other.position - p) < 3e-3
    assert one.is_known


@pytest.mark.skipif(torch.cuda.is_available(), reason="a CUDA device is there")
def test_a_device_that_is_not_there_is_named(rig: StereoRig) -> None:
    with pytest.raises(ValueError, match="device cuda"):
        MarkerBatch(MarkerParams(), Optics(rig.left), "cuda")


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device here")
def test_cuda_finds_what_the_cpu_finds(rig: StereoRig, robot: Robot, rng: np.random.Generator) -> None:
    images = np.stack(_balls(rig, robot, rng, 10)[0])
    for one, other in zip(
        *(MarkerBatch(MarkerParams(), Optics(rig.left), d).find(images) for d in ("cpu", "cuda")), strict=True
    ):
        assert one is not None
        assert other is not None
        assert np.allclose(one.center_px, other.center_px, atol=0.01)

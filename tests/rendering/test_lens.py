"""Lenses that cannot be, and what they are told to show."""

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.robot.icub import LEFT_EYE, RIGHT_EYE
from pps_vision.robot.model import Robot
from pps_vision.types import Array
from rendering.eyes import Eyes
from rendering.lens import Lens, pinholes
from rendering.scene import SceneState
from rendering.stimuli import make_stimulus


def test_a_lens_that_folds_the_image_back_is_refused() -> None:
    with pytest.raises(ValueError, match="expected a lens that can be undone over the whole image"):
        Lens(Camera(320, 240, 220.0, 220.0, 159.5, 119.5, (-1.0, 0.0, 0.0, 0.0, 0.0)))


def test_the_slopes_hold_all_that_projects_into_the_image() -> None:
    left, top, right, bottom = Lens(LEFT_EYE).slopes
    points = np.random.default_rng(0).uniform((-1.5, -1.5, 1), (1.5, 1.5, 1), (4000, 3))
    u, v = LEFT_EYE.project(points).T
    inside = (u > -0.5) & (u < 319.5) & (v > -0.5) & (v < 239.5)
    x, y = points[inside, :2].T
    assert left < x.min() < left + 0.03
    assert right - 0.03 < x.max() < right
    assert top < y.min() < top + 0.03
    assert bottom - 0.03 < y.max() < bottom


def test_without_distortion_the_slopes_are_those_of_a_pixel_beyond_the_border() -> None:
    slopes = Lens(Camera(32, 24, 30.0, 31.0, 15.3, 11.2)).slopes
    assert slopes == pytest.approx((-16.3 / 30, -12.2 / 31, 16.7 / 30, 12.8 / 31))


def test_at_twice_the_resolution_a_pixel_is_between_four() -> None:
    lens = Lens(Camera(32, 24, 30.0, 31.0, 15.3, 11.2))
    whole, fraction = lens.map_to(pinholes([lens], 2.0)[0])
    assert np.unique(fraction).tolist() == [16 * 32 + 16]  # half of OpenCV's 1/32 of a pixel along both axes
    assert (np.diff(whole[..., 0], axis=1) == 2).all()
    assert (np.diff(whole[..., 1], axis=0) == 2).all()


@pytest.mark.parametrize("scale", [1.0, 1.5])
def test_a_pinhole_image_holds_every_pixel_where_opencv_projects_from(scale: float) -> None:
    """Points of the pinhole image, projected by OpenCV, land on the pixels that the map takes from there."""
    lenses = [Lens(LEFT_EYE), Lens(RIGHT_EYE)]
    for lens, pinhole in zip(lenses, pinholes(lenses, scale), strict=True):
        whole, fraction = lens.map_to(pinhole)
        uv = whole + np.stack([fraction % 32, fraction // 32], axis=-1) / 32.0  # OpenCV's fixed point
        assert uv.min() >= 0
        assert uv.min(axis=(0, 1)).max() < scale + 1, "a margin of one of the lens's pixels, rounded up"
        assert uv[..., 0].max() <= pinhole.width - 1
        assert uv[..., 1].max() <= pinhole.height - 1
        xy = (uv - [pinhole.cx, pinhole.cy]) / [pinhole.fx, pinhole.fy]
        points = np.concatenate([xy.reshape(-1, 2), np.ones((uv[..., 0].size, 1))], axis=1)
        c = lens.camera
        px = cv2.projectPoints(points, np.zeros(3), np.zeros(3), c.K, np.array(c.distortion))[0].reshape(240, 320, 2)
        v, u = np.mgrid[:240, :320]
        assert np.abs(px - np.stack([u, v], axis=-1)).max() < 0.03
    assert len({(p.width, p.height) for p in pinholes(lenses, scale)}) == 1


def test_without_distortion_the_pinhole_image_is_only_cut_out() -> None:
    lens = Lens(Camera(32, 24, 30.0, 31.0, 15.3, 11.2))
    (pinhole,) = pinholes([lens], 1.0)
    image = np.random.default_rng(0).integers(0, 255, (pinhole.height, pinhole.width), np.uint8)
    du, dv = round(pinhole.cx - 15.3), round(pinhole.cy - 11.2)
    out = cv2.remap(image, *lens.map_to(pinhole), cv2.INTER_LINEAR)
    assert np.array_equal(out, image[dv : dv + 24, du : du + 32])


def test_everything_is_where_the_lens_bends_it_to(
    robot: Robot, rig: StereoRig, straight_rig: StereoRig, q: Array
) -> None:
    """Against OpenCV: the bent image straightened lies on what a perfect lens shows, to a fraction of a pixel
    (a trigger that knows the head's motion takes what slides by more for an object)."""
    images = []
    for eyes in (rig, straight_rig):
        with Eyes(robot, eyes, make_stimulus("ball")) as view:
            images.append(view.render(SceneState(q), 0.0).left)
    c = rig.left
    K = np.array([[c.fx, 0, c.cx], [0, c.fy, c.cy], [0, 0, 1]])
    straightened = cv2.undistort(images[0], K, np.array(c.distortion))
    shows = cv2.undistort(np.full((c.height, c.width), 255, np.uint8), K, np.array(c.distortion)) == 255
    grey = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (images[1], straightened)]
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM).calc(*grey, None)
    inner = cv2.erode(shows.astype(np.uint8), np.ones((25, 25))) > 0
    slide = np.linalg.norm(flow, axis=2)[inner]
    print(f"slide: median {np.median(slide):.3f}, 99 % {np.percentile(slide, 99):.3f} px")
    assert inner.mean() > 0.5
    assert np.median(slide) < 0.08
    assert np.percentile(slide, 99) < 0.4

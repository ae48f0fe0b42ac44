"""The object in batches of images: each step against an independent truth, and the whole against frame by frame."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from ball_scenes import Sphere, frame, look
from scipy import ndimage

from pps_vision.geometry.camera import Camera, StereoRig, View
from pps_vision.robot.icub import home
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Image, Status, StereoFrame
from tracking import batch
from tracking.appearance import ColorModel, color_bins, histogram
from tracking.batch import BatchTracker, OutlineBatch
from tracking.marker import MarkerParams, find_markers, threshold
from tracking.outline import Optics, cover
from tracking.tracker import Tracker, TrackerParams, TrackerStep

GREEN, BLUE = (15.0, 200.0, 40.0), (30.0, 60.0, 210.0)
DEVICES = [torch.device(name) for name in ("cpu", *(["cuda"] if torch.cuda.is_available() else []))]
on_every_device = pytest.mark.parametrize("device", DEVICES, ids=str)


@pytest.fixture
def find(rig: StereoRig) -> Callable[..., list[batch.Found]]:
    """Outlines of the default marker in images of the left eye."""

    def run(*images: Image, device: torch.device = DEVICES[0]) -> list[batch.Found]:
        return OutlineBatch(MarkerParams(), Optics(rig.left), device).find(np.stack(images))

    return run


# --- colour, against OpenCV ---------------------------------------------------------------------------------------


@on_every_device
def test_hsv_is_opencvs(device: torch.device) -> None:
    """Of every eighth level of each channel, and every dark and every bright one; but for ties, the rounded values of
    OpenCV's float conversion, and within 1 those of its fixed-point conversion, which rounds less exactly."""
    level = np.r_[0:16, 16:240:8, 240:256].astype(np.uint8)
    rgb = np.stack(np.meshgrid(level, level, level, indexing="ij"), axis=-1).reshape(1, -1, 3)
    found = torch.stack(batch.hsv(torch.from_numpy(rgb).to(device).movedim(-1, 0))).squeeze(1).cpu().numpy()
    exact = cv2.cvtColor(rgb.astype(np.float32) / 255, cv2.COLOR_RGB2HSV)[0].T * np.array([[0.5], [255], [255]])
    fixed = cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV)[0].astype(int).T
    for expected, share in ((np.floor(exact + 0.5), 0.01), (fixed, 0.02)):
        off = np.abs(found - expected)
        off[0] = np.minimum(off[0], 180 - off[0])
        assert off.max() <= 1
        assert (off > 0).mean() < share
    assert found[0].min() == 0
    assert found[0].max() == 179


@pytest.mark.parametrize("hue_deg", [120.0, 6.0, 350.0])
def test_marker_pixels_are_those_of_opencvs_thresholds(hue_deg: float, rng: np.random.Generator) -> None:
    """One range of hues, and two around 0°; all but the few colours that OpenCV's fixed point rounds less exactly."""
    rgb = rng.integers(0, 160, (1, 100_000, 3), dtype=np.uint8)
    params = MarkerParams(hue_deg=hue_deg, hue_tolerance_deg=30.0, min_saturation=0.4, min_value=0.4)
    found = batch.is_marker(torch.from_numpy(rgb).movedim(-1, 0)[None], params)[0].numpy()
    expected = threshold(params, rgb) > 0
    assert 0.05 < expected.mean() < 0.3
    assert (found != expected).mean() < 0.005


@on_every_device
def test_likelihood_images_are_the_trackers_look_up_tables(device: torch.device, rng: np.random.Generator) -> None:
    images = rng.integers(0, 256, (3, 40, 50, 3), dtype=np.uint8)
    model = ColorModel(*(histogram(rng.integers(0, 110, 500, dtype=np.uint8)) for _ in range(2)))
    found = batch.likelihood(torch.from_numpy(images).to(device), batch.color_table(model).to(device)).cpu().numpy()
    assert np.array_equal(found, np.stack([model.table()[color_bins(image)] for image in images]))
    marker = batch.likelihood(torch.from_numpy(images), batch.marker_table(MarkerParams())).numpy()
    quantised = np.stack([threshold(MarkerParams(), (image & 252) + 2) > 0 for image in images])
    assert (marker != quantised).mean() < 0.01
    assert marker.mean() == pytest.approx(quantised.mean(), rel=0.05)


# --- lens, against OpenCV -----------------------------------------------------------------------------------------


@on_every_device
def test_pixels_are_undistorted_as_opencv_does(rig: StereoRig, device: torch.device) -> None:
    """Directions within 1e-6 px, and solid angles, which add up to that of the image's border."""
    for camera in (rig.left, rig.right):
        weights = batch.lens_weights(camera, device).cpu().numpy()
        angle = weights[3]
        off_px = np.linalg.norm(weights[:3] / angle - np.moveaxis(camera.bearing_map, -1, 0), axis=0) * camera.focal_px
        assert off_px.max() < 1e-6
        assert np.allclose(angle, camera.solid_angle_map, rtol=1e-9)


# --- masks, against scipy.ndimage ---------------------------------------------------------------------------------


def _masks(rng: np.random.Generator) -> Array:
    """(42, 30, 34) blotches with holes and specks, nothing, everything, a bar above a bar, a ring above a speck."""
    smooth = ndimage.gaussian_filter(rng.standard_normal((38, 30, 34)), (0, 1.5, 1.5))
    blotches = smooth > rng.uniform(-0.1, 0.2, (38, 1, 1))
    drawn = np.zeros((4, 30, 34), bool)
    drawn[1] = True
    drawn[2, [4, 14], 8:20] = True
    drawn[3, 8:20, 8:20], drawn[3, 10:18, 10:18], drawn[3, 25, 25] = True, False, True
    return np.concatenate([blotches, drawn])


@on_every_device
def test_the_blob_in_the_middle_is_that_of_the_labelled_image(device: torch.device, rng: np.random.Generator) -> None:
    masks = _masks(rng)
    found = batch.middle_blob(torch.from_numpy(masks).to(device)).cpu().numpy()
    y, x = np.mgrid[:30, :34]
    holes = 0
    for mask, blob in zip(masks, found, strict=True):
        labels, _ = ndimage.label(mask, np.ones((3, 3)))
        far = np.where(mask, (y - 14.5) ** 2 + (x - 16.5) ** 2, np.inf)
        expected = (labels == labels.flat[np.argmin(far)]) & mask
        holes += not np.array_equal(expected, ndimage.binary_fill_holes(expected))
        assert np.array_equal(blob, ndimage.binary_fill_holes(expected))
    assert holes > 5


def test_eulers_number_is_components_less_holes(rng: np.random.Generator) -> None:
    masks = _masks(rng)
    found = batch.euler_number(torch.from_numpy(masks)).numpy()
    for mask, number in zip(masks, found, strict=True):
        background, _ = ndimage.label(np.pad(~mask, 1, constant_values=True))
        assert number == ndimage.label(mask, np.ones((3, 3)))[1] - (background.max() - 1)


@on_every_device
def test_box_sums_are_exact(device: torch.device, rng: np.random.Generator) -> None:
    values = rng.integers(0, 256, (3, 21, 33))
    for radius in (1, 6):
        found = batch.box_sums(torch.from_numpy(values).float().to(device), radius).cpu().numpy()
        whole = ndimage.convolve(values, np.ones((1, 2 * radius + 1, 2 * radius + 1)), mode="constant")
        assert np.array_equal(found, whole)


# --- moments, against analytic ones -------------------------------------------------------------------------------


@on_every_device
def test_moments_are_those_of_an_ellipse(device: torch.device) -> None:
    """Area πab, centroid, and the second moments a²/4, b²/4 along its axes, with a map of plain coordinates in place of
    the lens's: then `direction` is Σ(x, y, 1) and the covariance Σ(x, y, 1)(x, y, 1)ᵀ."""
    a, b, angle, center, k = 17.0, 9.0, 0.6, np.array([30.3, 33.8]), 16
    v, u = (np.mgrid[: 64 * k, : 64 * k] + 0.5) / k - 0.5
    dx, dy = u - center[0], v - center[1]
    across, down = np.cos(angle) * dx + np.sin(angle) * dy, np.cos(angle) * dy - np.sin(angle) * dx
    share = ((across / a) ** 2 + (down / b) ** 2 < 1).reshape(64, k, 64, k).mean(axis=(1, 3))
    y, x = np.mgrid[:64, :64].astype(float)
    maps = np.stack([x, y, np.ones_like(x), np.full_like(x, 1e-4)])
    alpha = torch.from_numpy(np.stack([share, 0 * share])).to(device)
    numbers, nothing = batch.moments(alpha, alpha, torch.from_numpy(maps).to(device).expand(2, 4, 64, 64)).cpu().numpy()
    area = np.pi * a * b
    assert numbers[14] == pytest.approx(area, rel=2e-3)
    assert numbers[3] == pytest.approx(1e-4 * area, rel=2e-3)
    assert np.allclose(numbers[:2] / numbers[2], center, atol=2e-3)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    expected = turn @ np.diag([a * a / 4, b * b / 4]) @ turn.T
    xx, xy, xz, _, yy, yz, _, zz, _, _ = numbers[4:14] / area
    found = np.array([[xx - xz * xz, xy - xz * yz], [xy - xz * yz, yy - yz * yz]])
    assert np.allclose(found, expected, rtol=5e-3, atol=0.1)
    assert zz == pytest.approx(1, rel=2e-3)
    half = np.sqrt(np.diag(turn @ np.diag([a * a, b * b]) @ turn.T))
    assert np.allclose(numbers[15:17], center - half, atol=1)
    assert np.allclose(numbers[17:19], 2 * half, atol=1)
    assert not nothing[[0, 1, 14, 17, 18]].any()


def test_coverage_is_that_of_frame_by_frame(rig: StereoRig, robot: Robot, rng: np.random.Generator) -> None:
    """In one batch: a small blob, whose band is narrower, a larger one, and one that hardly differs from the background
    and has a limb far from any pixel that is surely inside."""
    view = rig.view(home(robot)).left
    patches, masks = [], []
    for radius_m in (0.004, 0.02):
        ball = Sphere(view.center + 0.4 * view.rays([160.0, 120.0]), radius_m, GREEN)
        patches.append(look(view, [ball], rng)[88:152, 128:192])
        masks.append(threshold(MarkerParams(), patches[-1]) > 0)
    y, x = np.mgrid[:64, :64] - 32
    masks.append((np.hypot(x, y) < 8) | ((y == 0) & (x > 0) & (x < 24)))
    patches.append((rng.integers(100, 106, (64, 64, 3)) + 2 * masks[-1][..., None]).astype(np.uint8))
    alpha, variance = batch.coverage(
        torch.from_numpy(np.stack(patches)).permute(0, 3, 1, 2).float(), torch.from_numpy(np.stack(masks))
    )
    expected = [cover(image, mask, (0, 0, 64, 64)) for image, mask in zip(patches, masks, strict=True)]
    assert masks[0].sum() < 60 < masks[1].sum()
    assert np.allclose(alpha, [one.alpha for one in expected], atol=2e-4)
    assert np.allclose(variance, [one.variance for one in expected], atol=2e-4, rtol=1e-3)


# --- outlines, against discs at known places ----------------------------------------------------------------------


def _disc(camera: Camera, center: Array, radius: float) -> Image:
    """A green circle in the plane Z = 1 about (x, y, 1), seen through OpenCV's lens; 8×8 rays a pixel."""
    k, side = 8, 60
    corner = (_through(camera, center) - side / 2).astype(int)
    v, u = (np.mgrid[: side * k, : side * k] + 0.5) / k - 0.5
    pixels = (np.stack([u, v], axis=-1) + corner).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-10)
    rays = cv2.undistortPointsIter(pixels, camera.K, camera.lens, np.eye(3), np.eye(3), criteria)[:, 0]
    inside = np.hypot(*(rays - center).T) < radius
    share = inside.reshape(side, k, side, k).mean(axis=(1, 3))[..., None]
    image = np.full((camera.height, camera.width, 3), (120, 110, 100), np.uint8)
    image[corner[1] : corner[1] + side, corner[0] : corner[0] + side] = np.rint(
        share * GREEN + (1 - share) * image[0, 0]
    )
    return image


def _through(camera: Camera, point: Array) -> Array:
    """The pixel of a point (x, y, 1) by OpenCV."""
    pixel: Array = cv2.projectPoints(np.append(point, 1.0), np.zeros(3), np.zeros(3), camera.K, camera.lens)[0].ravel()
    return pixel


@on_every_device
@pytest.mark.parametrize("scale", [1, 2])
def test_a_disc_behind_a_lens_is_found_to_a_fiftieth_of_a_pixel(
    rig: StereoRig, device: torch.device, scale: int, rng: np.random.Generator
) -> None:
    """Its centre is that of its directions, each weighted with its solid angle: 1/length³ of its area in the plane."""
    one, radius = rig.left, 0.04
    size, focal = (scale * one.width, scale * one.height), (scale * one.fx, scale * one.fy)
    camera = Camera(*size, *focal, scale * one.cx, scale * one.cy, one.distortion)
    places = [
        np.array(at) + rng.uniform(-0.005, 0.005, 2) for at in ((-0.45, -0.2), (0.3, 0.35), (0.0, 0.0), (-0.3, 0.4))
    ]
    grid = np.stack(np.meshgrid(*[np.linspace(-radius, radius, 101)] * 2), axis=-1)
    plane = grid[np.hypot(*np.moveaxis(grid, -1, 0)) < radius]
    images = [_disc(camera, center, radius) for center in places]
    batches = OutlineBatch(MarkerParams(), Optics(camera), device)
    for center, found in zip(places, batches.find(np.stack(images)), strict=True):
        assert found is not None
        rays = np.column_stack([plane + center, np.ones(len(plane))])
        x, y, z = (rays / np.linalg.norm(rays, axis=1, keepdims=True) ** 4).sum(axis=0)
        assert np.linalg.norm(found[0].center_px - _through(camera, np.array([x / z, y / z]))) < 0.02


@on_every_device
def test_spheres_are_where_the_rays_meet_the_image(
    rig: StereoRig, robot: Robot, device: torch.device, find: Callable[..., list[batch.Found]], rng: np.random.Generator
) -> None:
    view = rig.view(home(robot)).left
    points = [view.center + rng.uniform(0.3, 0.6) * view.rays(rng.uniform((60, 60), (260, 180))) for _ in range(10)]
    images = [look(view, [Sphere(p, 0.006 + 0.001 * k, GREEN)], rng) for k, p in enumerate(points)]
    for p, image, found in zip(points, images, find(*images, device=device), strict=True):
        assert found is not None
        (one,) = found
        alone = find_markers(MarkerParams(), image, Optics(rig.left))[0]
        assert np.linalg.norm(one.center_px - view.project(p)) < 0.2
        assert np.allclose(one.center_px, alone.center_px, atol=0.02)
        assert one.angular_radius_rad == pytest.approx(alone.angular_radius_rad, rel=0.01)
        assert one.angular_radius_var == pytest.approx(alone.angular_radius_var, rel=0.05)
        assert np.allclose(one.cov_px, alone.cov_px, rtol=0.1, atol=1e-4)
        assert np.allclose(one.box_px, alone.box_px, atol=1)
        assert one.area_px == pytest.approx(alone.area_px, rel=0.02)
        assert not one.is_partial


def test_what_is_not_one_whole_marker_is_left_to_the_tracker(
    rig: StereoRig, robot: Robot, find: Callable[..., list[batch.Found]], rng: np.random.Generator
) -> None:
    view: View = rig.view(home(robot)).left

    def ball(u: float, v: float, radius_m: float) -> Sphere:
        return Sphere(view.center + 0.3 * view.rays([u, v]), radius_m, GREEN)

    one = ball(160, 120, 0.01)
    ring = look(view, [one], rng)
    ring[118:122, 158:162] = (250, 250, 250)
    two_apart, two_near = [one, ball(60, 60, 0.006)], [one, ball(180, 120, 0.006)]
    scenes = [
        look(view, some, rng)
        for some in ([], [one], two_apart, two_near, [ball(6, 120, 0.01)], [ball(160, 120, 0.036)])
    ]
    nothing, single, apart, near, border, huge, shiny = find(*scenes, ring)
    assert nothing == []
    assert single is not None
    assert shiny is not None
    assert np.allclose(shiny[0].center_px, single[0].center_px, atol=0.1)  # the hole counts as covered
    assert [apart, near, border, huge] == [None] * 4


def test_images_smaller_than_a_patch_are_left_to_the_tracker(rng: np.random.Generator) -> None:
    camera = Camera(60, 60, 60.0, 60.0, 30.0, 30.0)
    small = OutlineBatch(MarkerParams(), Optics(camera), DEVICES[0])
    assert small.find(np.zeros((2, 60, 60, 3), np.uint8)) == [None, None]


def test_images_of_another_camera_are_refused_by_the_tracker(rig: StereoRig, robot: Robot) -> None:
    image, q = np.zeros((100, 100, 3), np.uint8), home(robot)
    tracker = Tracker(TrackerParams("marker"), rig, np.random.default_rng(0))
    with pytest.raises(ValueError, match="left image"):
        BatchTracker(tracker, DEVICES[0]).steps([StereoFrame(image, image, 0.0, 0.0, q, q)])


# --- the whole, against frame by frame ----------------------------------------------------------------------------


def _film(
    rig: StereoRig, robot: Robot, color: tuple[float, float, float], rng: np.random.Generator
) -> list[StereoFrame]:
    """A ball that circles, is gone for a second, and comes back; for three frames a second one of its colour shows."""
    q, frames = home(robot), []
    middle = rig.view(q).left.center + 0.4 * rig.view(q).left.rays([150.0, 120.0])
    for k in range(27):
        p = middle + 0.03 * np.array([0.2 * np.sin(0.5 * k), np.cos(0.5 * k), np.sin(0.5 * k)])
        spheres = [Sphere(p, 0.012, color)] if k < 14 or k > 18 else []
        if 8 <= k < 11:
            spheres.append(Sphere(middle + np.array([0.0, 0.08, 0.06]), 0.008, color))
        frames.append(frame(rig, q, spheres, 0.05 * k if k < 16 else 0.05 * k + 1.0, rng))
    return frames


def _steps(params: TrackerParams, rig: StereoRig, frames: list[StereoFrame], size: int) -> list[TrackerStep]:
    tracker = Tracker(params, rig, np.random.default_rng(0))
    if not size:
        return [tracker.step(one) for one in frames]
    batches = BatchTracker(tracker, DEVICES[0])
    return [step for k in range(0, len(frames), size) for step in batches.steps(frames[k : k + size])]


@pytest.mark.parametrize(("mode", "color"), [("marker", GREEN), ("generic", BLUE)])
def test_the_track_is_that_of_frame_by_frame_whatever_the_batch(
    mode: str, color: tuple[float, float, float], rig: StereoRig, robot: Robot, rng: np.random.Generator
) -> None:
    """With eyes that are not alike: the right one's lens is a fifth longer."""
    rig = replace(rig, right=replace(rig.right, fx=1.2 * rig.right.fx, fy=1.2 * rig.right.fy))
    params, frames = TrackerParams(mode=mode), _film(rig, robot, color, rng)
    alone, *batched = (_steps(params, rig, frames, size) for size in (0, 5, 64))
    known = [step.track.is_known for step in alone]
    assert sum(known) > 12
    assert not all(known[14:19])
    for steps in batched:
        assert [step.track.status for step in steps] == [step.track.status for step in alone]
        for one, other in zip(alone, steps, strict=True):
            assert len(one.detections) == len(other.detections)
            for a, b in zip(one.detections, other.detections, strict=True):
                assert np.allclose(a.center_px, b.center_px, atol=0.05)
            if one.track.is_known:  # without an observation the velocity's difference adds up
                limit_m = 2e-4 if one.observation else 1e-3
                assert np.linalg.norm(one.track.position - other.track.position) < limit_m
                assert other.track.radius_m == pytest.approx(one.track.radius_m, rel=0.01)
    first, *rest = ([step.track.mean for step in steps] for steps in batched)
    for means in rest:
        assert np.allclose(means, first, rtol=0, atol=1e-7, equal_nan=True)


def test_a_confirmed_ball_is_found_in_batches_without_its_particles(
    rig: StereoRig, robot: Robot, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames, tracker = _film(rig, robot, BLUE, rng)[:14], Tracker(TrackerParams(), rig, np.random.default_rng(0))
    batches = BatchTracker(tracker, DEVICES[0])
    batches.steps(frames[:6])
    assert tracker.appearance is not None
    monkeypatch.setattr("tracking.image_tracker.ImageTracker.step", lambda *_: pytest.fail("searched frame by frame"))
    for step in batches.steps(frames[6:8]):
        assert len(step.detections) == 2


def test_in_a_grey_image_outlines_by_colour_are_not_used(
    rig: StereoRig, robot: Robot, rng: np.random.Generator
) -> None:
    """Given outlines 3 px off: the tracker takes them in a colour image, and not in a grey one."""
    for grey in (False, True):
        tracker = Tracker(TrackerParams(), rig, np.random.default_rng(0))
        *before, last = _film(rig, robot, BLUE, rng)[:8]
        for one in before:
            seen = tracker.step(one).detections
        shapes = OutlineBatch(tracker.appearance[0], Optics(rig.left), DEVICES[0]).find(last.left[None])[0]  # type: ignore[index]
        assert shapes
        off = replace(shapes[0], center_px=shapes[0].center_px + 3.0)
        right = OutlineBatch(tracker.appearance[1], Optics(rig.right), DEVICES[0]).find(last.right[None])[0]  # type: ignore[index]
        if grey:
            last = replace(
                last,
                **{
                    eye: cv2.cvtColor(getattr(last, eye), cv2.COLOR_RGB2GRAY)[..., None].repeat(3, 2)
                    for eye in ("left", "right")
                },
            )
        step = tracker.step(last, ([off], right))
        given = [one for one in step.detections if one.camera == "left" and np.allclose(one.center_px, off.center_px)]
        assert bool(given) != grey
        assert seen


def test_a_lost_balls_colours_are_no_longer_searched(rig: StereoRig, robot: Robot, rng: np.random.Generator) -> None:
    q, frames = home(robot), _film(rig, robot, BLUE, rng)[:8]
    empty = [frame(rig, q, [], 0.05 * (8 + k), rng) for k in range(14)]
    tracker, marker = (Tracker(TrackerParams(mode), rig, np.random.default_rng(0)) for mode in ("generic", "marker"))
    for one in frames:
        tracker.step(one)
        marker.step(one)
    assert tracker.appearance is not None
    statuses = [tracker.step(one).track.status for one in empty]
    assert Status.LOST in statuses
    assert tracker.appearance is None
    assert marker.appearance is not None  # a marker's hue is known all along


def test_process_wide_state_is_left_alone(rig: StereoRig, find: Callable[..., list[batch.Found]]) -> None:
    before = torch.random.get_rng_state(), torch.get_num_threads(), torch.get_default_dtype()
    find(np.full((rig.left.height, rig.left.width, 3), 90, np.uint8))
    after = torch.random.get_rng_state(), torch.get_num_threads(), torch.get_default_dtype()
    assert torch.equal(before[0], after[0])
    assert before[1:] == after[1:]

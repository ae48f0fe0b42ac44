"""The whole tracker on ray-cast scenes, whose truth is where the spheres were put."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
import pytest
from ball_scenes import ROOM_M, Sphere, frame

from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.icub import home, set_gaze
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Status, StereoFrame
from tracking.marker import MarkerParams
from tracking.particle_filter import ParticleFilterParams
from tracking.stereo import StereoParams
from tracking.tracker import Tracker, TrackerParams, TrackerStep

RED = (210.0, 45.0, 40.0)
GREEN = (25.0, 200.0, 60.0)
DT = 0.05
Balls = Callable[[float], list[Sphere]]


@dataclass(frozen=True)
class BallScene:
    """A red ball on a slow arc before a head that moves."""

    robot: Robot
    rig: StereoRig

    def q(self, t: float) -> Array:
        yaw = 0.06 * np.sin(1.5 * t)
        return set_gaze(self.robot, home(self.robot), yaw=yaw, pitch=-0.2 + 0.04 * np.sin(1.1 * t), vergence=0.16)

    def at(self, *ahead_m: float) -> Array:
        """The point (3,) at these coordinates of the left eye as the head begins, root frame."""
        return (self.rig.view(self.q(0.0)).left.T_root_camera @ np.array([*ahead_m, 1.0]))[:3]

    def position(self, t: float) -> Array:
        return self.at(0.04 + 0.06 * np.sin(1.6 * t), 0.05 * np.cos(1.6 * t), 0.42 - 0.03 * t)

    def ball(self, t: float, radius_m: float = 0.035, color: tuple[float, float, float] = RED) -> Sphere:
        return Sphere(self.position(t), radius_m, color)

    def frame(self, k: int, rng: np.random.Generator, balls: Balls | None = None) -> StereoFrame:
        t = DT * k
        return frame(self.rig, self.q(t), balls(t) if balls else [self.ball(t)], t, rng)

    def empty(self, k: int, rng: np.random.Generator) -> StereoFrame:
        return self.frame(k, rng, lambda _: [])

    def patch(self, across: float) -> Sphere:
        """A green patch on the wall ahead of the head: half of a small ball in it."""
        ahead = self.rig.view(self.q(0.0)).left.T_root_camera
        direction = ahead[:3, :3] @ np.array([across, -0.1, 1.0])
        k = int(np.abs(direction).argmax())
        distance_m = (np.copysign(ROOM_M, direction[k]) - ahead[k, 3]) / direction[k]
        return Sphere(ahead[:3, 3] + distance_m * direction, 0.06, GREEN)


@pytest.fixture
def world(robot: Robot, rig: StereoRig) -> BallScene:
    return BallScene(robot, rig)


@pytest.fixture
def tracker(rig: StereoRig, rng: np.random.Generator) -> Tracker:
    return Tracker(TrackerParams(), rig, rng)


@pytest.fixture
def marker_tracker(rig: StereoRig, rng: np.random.Generator) -> Tracker:
    return Tracker(TrackerParams(mode="marker"), rig, rng)


def off_m(world: BallScene, steps: list[TrackerStep]) -> Array:
    """Distances of the known positions from the ball's, m."""
    tracks = [step.track for step in steps if step.track.is_known]
    return np.array([np.linalg.norm(track.position - world.position(track.stamp_s)) for track in tracks])


def rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def test_a_ball_is_tracked_to_a_third_of_a_millimetre_while_the_head_moves(world, rng):
    names: list[str] = []

    @contextmanager
    def stage(name: str) -> Iterator[None]:
        names.append(name)
        yield

    tracker = Tracker(TrackerParams(), world.rig, rng, stages=stage)
    steps = [tracker.step(world.frame(k, rng)) for k in range(40)]
    assert steps[0].track.status is Status.SEARCHING
    assert np.isnan(steps[0].track.mean).all()
    assert all(step.track.status is Status.TRACKING for step in steps[10:])
    assert rms(off_m(world, steps)) < 0.0003
    last = steps[-1].track
    assert last.radius_m == pytest.approx(0.035, rel=0.03)
    assert np.linalg.eigvalsh(last.cov).min() > -1e-12
    velocity = (world.position(39 * DT + 0.01) - world.position(39 * DT - 0.01)) / 0.02
    assert np.linalg.norm(last.velocity - velocity) < 0.004
    assert {detection.camera for detection in steps[-1].detections} == {"left", "right"}
    assert [steps[k].followed_by for k in (0, -1)] == [None, "colour"]
    assert set(names) == {"trigger", "image", "triangulation", "filter"}


def test_a_marker_is_tracked_to_half_a_millimetre_and_found_where_it_rests_before_the_wall(world, rng):
    for moves, n in ((True, 25), (False, 12)):
        tracker = Tracker(TrackerParams(mode="marker"), world.rig, rng)
        balls = {k: world.ball(moves * DT * k, 0.010, GREEN) for k in range(n)}
        steps = [tracker.step(frame(world.rig, world.q(DT * k), [ball], DT * k, rng)) for k, ball in balls.items()]
        assert all(step.track.status is Status.TRACKING for step in steps[4:])
        assert steps[-1].followed_by == "hue"
        off = [np.linalg.norm(s.track.position - world.position(moves * s.track.stamp_s)) for s in steps[4:]]
        assert rms(np.array(off)) < 0.0005 if moves else max(off) < 0.004


@pytest.mark.parametrize("kind", ["patch of the wall", "large and pale"])
def test_of_two_things_of_its_hue_the_marker_is_the_one_that_moves(kind, world, marker_tracker, rng):
    """A patch on the wall; or a large pale green ball behind it, with which the marker's hue joins it."""
    pale = Sphere(world.at(0.05, 0.0, 1.0), 0.3, (60.0, 140.0, 70.0))
    background, radius_m = (pale, 0.012) if kind == "large and pale" else (world.patch(-0.2), 0.01)
    frames = [world.frame(k, rng, lambda t: [background, world.ball(t, radius_m, GREEN)]) for k in range(30)]
    off = off_m(world, [marker_tracker.step(stereo_frame) for stereo_frame in frames])
    assert len(off) >= 20
    assert off.max() < 0.0015


def test_a_marker_that_rests_from_the_first_image_on_is_found_whole_once_it_moves(robot, view, marker_tracker, rng):
    """Before eyes at rest it is background until then; the background is reset at its place."""
    tracks = []
    for k in range(9):
        p = (view.left.T_root_camera @ np.array([0.02 + 0.006 * max(k - 3, 0), 0.02, 0.4, 1.0]))[:3]
        stereo_frame = frame(marker_tracker.rig, home(robot), [Sphere(p, 0.015, GREEN)], DT * k, rng)
        tracks.append(marker_tracker.step(stereo_frame).track)
        if tracks[-1].is_known:
            assert np.linalg.norm(tracks[-1].position - p) < 0.0005
            assert tracks[-1].radius_m == pytest.approx(0.015, rel=0.05)
    assert [track.status for track in tracks[:5]] == [Status.SEARCHING] * 5
    assert tracks[-1].status is Status.TRACKING


def test_hidden_it_coasts_is_lost_and_comes_back(world, tracker, rng):
    """After a short gap, and after a long one."""
    for k in range(15):
        tracker.step(world.frame(k, rng))
    gap = [tracker.step(world.empty(k, rng)).track.status for k in range(15, 19)]
    assert gap == [Status.COASTING] * 4
    again = [tracker.step(world.frame(k, rng)).track.status for k in range(19, 25)]
    assert again[-3:] == [Status.TRACKING] * 3
    hidden = [tracker.step(world.empty(k, rng)).track for k in range(25, 42)]
    coasting = [track for track in hidden if track.status is Status.COASTING]
    assert hidden[0].status is Status.COASTING
    assert np.all(np.diff([np.trace(track.cov[:3, :3]) for track in coasting]) > 0)
    assert all(np.all(np.isfinite(t.mean)) and np.linalg.eigvalsh(t.cov[:3, :3]).min() > 0 for t in coasting)
    (lost,) = (track for track in hidden if track.status is Status.LOST)
    assert lost.stamp_s - 24 * DT == pytest.approx(0.5, abs=1.5 * DT)
    assert np.isnan(lost.mean).all()
    assert hidden[-1].status is Status.SEARCHING
    back = [tracker.step(world.frame(k, rng)) for k in range(42, 50)]
    assert back[-1].track.status is Status.TRACKING
    assert off_m(world, back)[-1] < 0.0003


@pytest.mark.parametrize("hidden", [False, True])
def test_a_ball_that_reverses_at_1_m_per_s_is_tracked_through_it(hidden, robot, rig, tracker, rng):
    """Ten centimetres from where it is predicted; also where a hand that moves with it hides part of it: to 5 mm across
    the line of sight, in depth as stated."""
    eyes = rig.view(home(robot))
    T = eyes.left.T_root_camera

    def sight(p: Array) -> Array:
        return (p - eyes.midpoint) / np.linalg.norm(p - eyes.midpoint)

    tracks = []
    for k in range(14):
        x = -0.1 + 0.05 * (k if k < 9 else 16 - k)
        place, hand = ((T @ np.array([x + dx, dy, z, 1.0]))[:3] for dx, dy, z in ((0, 0, 0.6), (-0.015, 0.025, 0.54)))
        balls = [Sphere(place, 0.035, RED), *[Sphere(hand, 0.025, (90.0, 60.0, 200.0))] * (hidden and k > 4)]
        track = tracker.step(frame(rig, home(robot), balls, DT * k, rng)).track
        tracks.append(track)
        if k > 3:
            off = track.position - place
            assert np.linalg.norm(off - (off @ sight(place)) * sight(place)) < 0.005
            assert off @ np.linalg.solve(track.cov[:3, :3], off) < 16.3  # 99.9 %
    assert all(track.status is Status.TRACKING for track in tracks[3:])


def test_a_body_of_two_colors_is_one_object(world, tracker, rng):
    """Two touching balls of different colours; their middle lies between them."""
    half = np.array([0.0, 0.0, 0.022])
    colors = (120.0, 30.0, 190.0), (220.0, 110.0, 20.0)

    def balls(t: float) -> list[Sphere]:
        p = world.position(t)
        return [Sphere(p + half, 0.025, colors[0]), Sphere(p - half, 0.025, colors[1])]

    steps = [tracker.step(world.frame(k, rng, balls)) for k in range(30)]
    assert all(step.track.status is Status.TRACKING for step in steps[10:])
    assert off_m(world, steps[10:]).max() < 0.0025


def test_a_marker_hidden_by_something_larger_of_its_hue_is_not_claimed_elsewhere(world, rng):
    """A far larger ball of a brownish red comes up before the lower half of a red one, whose hue it has."""
    tracker = Tracker(TrackerParams(mode="marker", marker=MarkerParams(hue_deg=0.0)), world.rig, rng)

    def balls(t: float) -> list[Sphere]:
        eyes = world.rig.view(world.q(t))
        middle = 0.5 * (eyes.left.center + eyes.right.center)
        down = eyes.left.T_root_camera[:3, 1]
        top = middle + 0.8 * (world.position(t) - middle) + 0.028 * np.clip((16 - t / DT) / 8, 0, 1) * down
        return [world.ball(t), Sphere(top + 0.3 * down, 0.3, (150.0, 95.0, 72.0))][: 1 if t < 7.5 * DT else 2]

    steps = [tracker.step(world.frame(k, rng, balls)) for k in range(34)]
    assert [step.track.status for step in steps[6:8]] == [Status.TRACKING] * 2
    assert off_m(world, steps).max() < 0.02


def test_where_nothing_or_only_a_patch_of_its_hue_is_nothing_is_tracked(world, tracker, marker_tracker, rng):
    for k in range(25):
        step = tracker.step(world.empty(k, rng))
        assert (step.track.status, step.observation) == (Status.SEARCHING, None)
        step = marker_tracker.step(world.frame(k, rng, lambda _: [world.patch(0.1)]))
        assert (step.track.status, step.observation) == (Status.SEARCHING, None)


@pytest.mark.parametrize(("color", "stripes"), [((128.0, 128.0, 128.0), 0), ((30.0, 30.0, 30.0), 0), (RED, 4)])
def test_eyes_at_rest_track_what_no_single_colour_separates(rig, robot, view, color, stripes, tracker, rng):
    """A grey, a black and a striped ball, which rest in view for half a second and then move."""
    off = []
    radii = []
    for k in range(40):
        position = (view.left.T_root_camera @ np.array([-0.05 + 0.008 * max(k - 10, 0), 0.02, 0.45, 1.0]))[:3]
        step = tracker.step(frame(rig, home(robot), [Sphere(position, 0.03, color, stripes)], DT * k, rng))
        if step.track.status is Status.TRACKING:
            off.append(np.linalg.norm(step.track.position - position))
            radii.append(step.track.radius_m)
    assert len(off) > 15
    assert np.median(off) < 0.01  # of 14 px radius: a disparity of 0.7 px
    assert max(off) < 0.015
    assert np.median(radii) == pytest.approx(0.03, rel=0.1)
    assert step.followed_by == ("colour" if stripes else "background")


def test_eyes_that_look_one_after_the_other(world, tracker, rng):
    steps = []
    for k in range(18):
        early = world.frame(k, rng)
        t = DT * k + 0.02
        late = frame(world.rig, world.q(t), [world.ball(t)], t, rng)
        pair = StereoFrame(early.left, late.right, DT * k, t, early.joints_left_rad, late.joints_right_rad)
        steps.append(tracker.step(pair))
    off = off_m(world, steps)
    assert len(off) > 9
    assert max(off) < 0.004  # the first velocities are uncertain
    assert rms(off[6:]) < 0.0003


def test_a_refused_frame_changes_nothing_and_the_next_one_is_taken(world, tracker, rng):
    tracker.step(world.empty(0, rng))
    good = world.frame(1, rng)
    for changes, says in (
        ({"right": good.right[::2, ::2]}, r"right image \(120, 160, 3\) uint8; expected \(240, 320, 3\) uint8"),
        ({"left": good.left.astype(np.int16)}, r"left image \(240, 320, 3\) int16; expected \(240, 320, 3\) uint8"),
        ({"left": good.left[..., 0]}, r"left image \(240, 320\) uint8"),
        ({"stamp_left_s": -0.1}, r"left stamp -0\.100000 s after 0\.000000 s"),
        ({"stamp_right_s": np.nan}, "right stamp nan s"),
        ({"stamp_right_s": 0.0}, r"right stamp 0\.000000 s after 0\.000000 s"),
        ({"joints_right_rad": np.zeros(3)}, "3"),
        ({"joints_left_rad": None}, "joints"),
    ):
        previous = tracker.state
        with pytest.raises(ValueError, match=says):
            tracker.step(replace(good, **changes))
        assert tracker.state is previous
    assert tracker.step(good).track.status is Status.SEARCHING


@pytest.mark.parametrize("mode", ["generic", "marker"])
def test_what_one_eye_alone_sees_is_still_reported(mode, world, rng):
    """From frame 20 the right eye no longer sees the ball."""
    tracker = Tracker(TrackerParams(mode=mode), world.rig, rng)
    for k in range(24):
        stereo_frame = world.frame(k, rng, lambda t: [world.ball(t, color=GREEN)])
        step = tracker.step(replace(stereo_frame, right=world.empty(k, rng).right) if k >= 20 else stereo_frame)
    assert step.track.status is Status.COASTING
    (detection,) = step.detections
    assert detection.camera == "left"
    truth = world.rig.view(world.q(DT * 23)).left.project(world.position(DT * 23))
    np.testing.assert_allclose(detection.center_px, truth, atol=1.0)


@pytest.mark.parametrize(
    ("params", "change", "says"),
    [
        (TrackerParams, {"mode": "magic"}, "'magic'"),
        (TrackerParams, {"lost_after_s": 0.0}, "lost after 0"),
        (TrackerParams, {"aspect_rad": 0.0}, "aspect 0"),
        (TrackerParams, {"stamp_error_s": -0.01}, r"± -0\.01 s"),
        (StereoParams, {"farthest": -1.0}, "expected positive numbers"),
        (ParticleFilterParams, {"count": 1}, "count=1"),
    ],
)
def test_bad_parameters_are_named(params, change, says):
    with pytest.raises(ValueError, match=says):
        params(**change)

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
from tracking.image_tracker import ImageTrackerParams
from tracking.marker import MarkerParams
from tracking.stereo import StereoParams
from tracking.tracker import Tracker, TrackerParams, TrackerStep

RED = (210.0, 45.0, 40.0)
GREEN = (25.0, 200.0, 60.0)
DT = 0.05


@dataclass(frozen=True)
class BallScene:
    """A ball on a slow arc before a head that moves."""

    robot: Robot
    rig: StereoRig
    radius_m: float = 0.035
    color: tuple[float, float, float] = RED
    stripes: int = 0

    def q(self, t: float) -> Array:
        return set_gaze(
            self.robot,
            home(self.robot),
            yaw=0.06 * np.sin(1.5 * t),
            pitch=-0.2 + 0.04 * np.sin(1.1 * t),
            vergence=0.16,
        )

    def position(self, t: float) -> Array:
        ahead = self.rig.view(self.q(0.0)).left.T_root_camera
        at = [0.04 + 0.06 * np.sin(1.6 * t), 0.05 * np.cos(1.6 * t), 0.42 - 0.03 * t, 1.0]
        return (ahead @ np.array(at))[:3]

    def frame(self, k: int, rng: np.random.Generator, visible: bool = True) -> StereoFrame:
        ball = Sphere(self.position(DT * k), self.radius_m, self.color, self.stripes)
        return frame(self.rig, self.q(DT * k), [ball] if visible else [], DT * k, rng)


@pytest.fixture
def world(robot: Robot, rig: StereoRig) -> BallScene:
    return BallScene(robot, rig)


def _run(world: BallScene, tracker: Tracker, n: int, rng: np.random.Generator) -> tuple[list[TrackerStep], Array]:
    steps = [tracker.step(world.frame(k, rng)) for k in range(n)]
    errors = [s.track.position - world.position(s.track.stamp_s) for s in steps if s.track.is_known]
    return steps, np.array(errors)


def _rms(errors: Array) -> float:
    return float(np.sqrt((errors**2).sum(axis=1).mean()))


def test_a_ball_is_tracked_to_two_millimetres_while_the_head_moves(world: BallScene, rng: np.random.Generator) -> None:
    names: list[str] = []

    @contextmanager
    def stage(name: str) -> Iterator[None]:
        names.append(name)
        yield

    tracker = Tracker(TrackerParams(), world.rig, rng, stages=stage)
    steps, errors = _run(world, tracker, 40, rng)
    assert steps[0].track.status is Status.SEARCHING
    assert np.isnan(steps[0].track.mean).all()
    assert all(s.track.status is Status.TRACKING for s in steps[10:])
    assert _rms(errors) < 0.0025
    last = steps[-1].track
    assert last.radius_m == pytest.approx(0.035, rel=0.03)
    assert np.linalg.eigvalsh(last.cov).min() > -1e-12
    velocity = (world.position(39 * DT + 0.01) - world.position(39 * DT - 0.01)) / 0.02
    assert np.linalg.norm(last.velocity - velocity) < 0.03
    assert {d.camera for d in steps[-1].detections} == {"left", "right"}
    assert steps[0].followed_by is None
    assert steps[-1].followed_by == "colour"
    assert set(names) == {"trigger", "image", "triangulation", "filter"}


def test_a_marker_is_tracked_to_two_millimetres(world: BallScene, rng: np.random.Generator) -> None:
    small = replace(world, radius_m=0.010, color=GREEN)
    steps, errors = _run(small, Tracker(TrackerParams(mode="marker"), world.rig, rng), 25, rng)
    assert all(s.track.status is Status.TRACKING for s in steps[4:])
    assert steps[-1].followed_by == "hue"
    assert _rms(errors) < 0.002


def _marker_tracks(
    world: BallScene, rng: np.random.Generator, balls: Callable[[float], list[Sphere]], n: int = 30
) -> list[tuple[float, TrackerStep]]:
    tracker = Tracker(TrackerParams(mode="marker"), world.rig, rng)
    stamps = [DT * k for k in range(n)]
    return [(t, tracker.step(frame(world.rig, world.q(t), balls(t), t, rng))) for t in stamps]


def _patch(world: BallScene, across: float) -> Sphere:
    """A green patch on the wall ahead of the head: half of a small ball in it."""
    ahead = world.rig.view(world.q(0.0)).left.T_root_camera
    direction = ahead[:3, :3] @ np.array([across, -0.1, 1.0])
    k = int(np.abs(direction).argmax())
    distance_m = (np.copysign(ROOM_M, direction[k]) - ahead[k, 3]) / direction[k]
    return Sphere(ahead[:3, 3] + distance_m * direction, 0.06, GREEN)


def test_a_patch_of_the_wall_is_no_marker(world: BallScene, rng: np.random.Generator) -> None:
    steps = _marker_tracks(world, rng, lambda _: [_patch(world, 0.1)])
    assert {step.track.status for _, step in steps} == {Status.SEARCHING}


def test_a_marker_that_rests_before_the_wall_is_found(world: BallScene, rng: np.random.Generator) -> None:
    steps = _marker_tracks(world, rng, lambda _: [Sphere(world.position(0.0), 0.01, GREEN)], 12)
    assert all(step.track.status is Status.TRACKING for _, step in steps[4:])
    assert max(np.linalg.norm(step.track.position - world.position(0.0)) for _, step in steps[4:]) < 0.004


def test_a_marker_that_rests_from_the_first_image_on_is_found_whole_once_it_moves(
    robot: Robot, rig: StereoRig, rng: np.random.Generator
) -> None:
    """Before eyes at rest it is background until then; the background is reset at its place."""
    tracker = Tracker(TrackerParams(mode="marker"), rig, rng)
    q = home(robot)
    ahead = rig.view(q).left.T_root_camera
    tracks = []
    for k in range(9):
        p = (ahead @ np.array([0.02 + 0.006 * max(k - 3, 0), 0.02, 0.4, 1.0]))[:3]
        tracks.append(tracker.step(frame(rig, q, [Sphere(p, 0.015, GREEN)], DT * k, rng)).track)
        if tracks[-1].is_known:
            assert np.linalg.norm(tracks[-1].position - p) < 0.002
            assert tracks[-1].radius_m == pytest.approx(0.015, rel=0.05)
    assert [track.status for track in tracks[:5]] == [Status.SEARCHING] * 5
    assert tracks[-1].status is Status.TRACKING


def test_of_two_things_of_its_hue_the_marker_is_the_one_that_moves(world: BallScene, rng: np.random.Generator) -> None:
    steps = _marker_tracks(world, rng, lambda t: [_patch(world, -0.2), Sphere(world.position(t), 0.01, GREEN)])
    is_known = [np.linalg.norm(step.track.position - world.position(t)) for t, step in steps if step.track.is_known]
    assert len(is_known) >= 20
    assert max(is_known) < 0.005


def test_a_marker_before_something_large_of_its_hue_is_told_by_its_colours(
    world: BallScene, rng: np.random.Generator
) -> None:
    """A green marker before a large pale green ball, with which its hue joins it."""

    def balls(t: float) -> list[Sphere]:
        ahead = world.rig.view(world.q(0.0)).left.T_root_camera
        distance_m = (ahead @ np.array([0.05, 0.0, 1.0, 1.0]))[:3]
        return [Sphere(distance_m, 0.3, (60.0, 140.0, 70.0)), Sphere(world.position(t), 0.012, GREEN)]

    steps = _marker_tracks(world, rng, balls)
    is_known = [np.linalg.norm(step.track.position - world.position(t)) for t, step in steps if step.track.is_known]
    assert len(is_known) >= 20
    assert max(is_known) < 0.006


def test_hidden_it_coasts_is_lost_and_comes_back(world: BallScene, rng: np.random.Generator) -> None:
    tracker = Tracker(TrackerParams(lost_after_s=0.5), world.rig, rng)
    _run(world, tracker, 15, rng)
    hidden = [tracker.step(world.frame(k, rng, visible=False)).track for k in range(15, 32)]
    coasting = [t for t in hidden if t.status is Status.COASTING]
    assert hidden[0].status is Status.COASTING
    assert np.all(np.diff([np.trace(t.cov[:3, :3]) for t in coasting]) > 0)
    assert all(np.all(np.isfinite(t.mean)) and np.linalg.eigvalsh(t.cov[:3, :3]).min() > 0 for t in coasting)
    lost = [t for t in hidden if t.status is Status.LOST]
    assert len(lost) == 1
    assert lost[0].stamp_s - 14 * DT == pytest.approx(0.5, abs=1.5 * DT)
    assert np.isnan(lost[0].mean).all()
    assert hidden[-1].status is Status.SEARCHING
    back = [tracker.step(world.frame(k, rng)).track for k in range(32, 40)]
    assert back[-1].status is Status.TRACKING
    assert np.linalg.norm(back[-1].position - world.position(39 * DT)) < 0.003


def test_a_short_gap_does_not_lose_it(world: BallScene, rng: np.random.Generator) -> None:
    tracker = Tracker(TrackerParams(), world.rig, rng)
    _run(world, tracker, 15, rng)
    for k in range(15, 19):
        assert tracker.step(world.frame(k, rng, visible=False)).track.status is Status.COASTING
    again = [tracker.step(world.frame(k, rng)).track.status for k in range(19, 23)]
    assert again[-1] is Status.TRACKING


def _black(f: StereoFrame, _: StereoFrame) -> StereoFrame:
    return replace(f, right=np.zeros_like(f.right))


def _frozen(f: StereoFrame, previous: StereoFrame) -> StereoFrame:
    return replace(f, right=previous.right)


@pytest.mark.parametrize("spoil", [_black, _frozen])
def test_a_failed_eye_loses_the_track_and_invents_none(
    world: BallScene, rng: np.random.Generator, spoil: Callable[[StereoFrame, StereoFrame], StereoFrame]
) -> None:
    tracker = Tracker(TrackerParams(), world.rig, rng)
    _run(world, tracker, 12, rng)
    previous = world.frame(12, rng)
    assert tracker.step(previous).track.status is Status.TRACKING
    steps = [tracker.step(spoil(world.frame(k, rng), previous)) for k in range(13, 27)]
    status = [step.track.status for step in steps]
    coasting = status.count(Status.COASTING)
    assert coasting in (9, 10)  # half a second
    assert status == [Status.COASTING] * coasting + [Status.LOST] + [Status.SEARCHING] * (13 - coasting)
    for step in steps:
        assert not step.detections
        assert step.track.is_known == (step.track.status is Status.COASTING)
        assert not step.track.is_known or np.all(np.isfinite(step.track.cov))


def test_a_body_of_two_colors_is_one_object(world: BallScene, rng: np.random.Generator) -> None:
    """Two touching balls of different colours; their middle lies between them."""
    tracker = Tracker(TrackerParams(), world.rig, rng)
    half = np.array([0.0, 0.0, 0.022])
    for k in range(30):
        p = world.position(DT * k)
        balls = [Sphere(p + half, 0.025, (120.0, 30.0, 190.0)), Sphere(p - half, 0.025, (220.0, 110.0, 20.0))]
        track = tracker.step(frame(world.rig, world.q(DT * k), balls, DT * k, rng)).track
        if k >= 10:
            assert track.status is Status.TRACKING
            assert np.linalg.norm(track.position - p) < 0.008


def test_a_marker_hidden_by_something_larger_of_its_hue_is_not_claimed_elsewhere(
    world: BallScene, rng: np.random.Generator
) -> None:
    """A far larger ball of a brownish red comes up before the lower half of a red one, whose hue it has."""
    tracker = Tracker(TrackerParams(mode="marker", marker=MarkerParams(hue_deg=0.0)), world.rig, rng)
    errors = []
    for k in range(34):
        q = world.q(DT * k)
        p = world.position(DT * k)
        eyes = world.rig.view(q)
        middle = 0.5 * (eyes.left.center + eyes.right.center)
        down = eyes.left.T_root_camera[:3, 1]
        top = middle + 0.8 * (p - middle) + 0.8 * world.radius_m * np.clip((16 - k) / 8, 0, 1) * down
        balls = [Sphere(p, world.radius_m, world.color)]
        if k >= 8:
            balls.append(Sphere(top + 0.3 * down, 0.3, (150.0, 95.0, 72.0)))
        step = tracker.step(frame(world.rig, q, balls, DT * k, rng))
        errors.append((step.track.status, float(np.linalg.norm(step.track.position - p))))
    assert [status for status, _ in errors[6:8]] == [Status.TRACKING] * 2
    assert all(off < 0.02 for status, off in errors if status in (Status.TRACKING, Status.COASTING))


def test_nothing_moves_nothing_is_tracked(world: BallScene, rng: np.random.Generator) -> None:
    tracker = Tracker(TrackerParams(), world.rig, rng)
    for k in range(25):
        step = tracker.step(world.frame(k, rng, visible=False))
        assert step.track.status is Status.SEARCHING
        assert step.observation is None


@pytest.mark.parametrize(("color", "stripes"), [((128.0, 128.0, 128.0), 0), ((30.0, 30.0, 30.0), 0), (RED, 4)])
def test_eyes_at_rest_track_what_no_single_colour_separates(
    rig: StereoRig, robot: Robot, color: tuple[float, float, float], stripes: int, rng: np.random.Generator
) -> None:
    """A grey, a black and a striped ball, which rest in view for half a second and then move."""
    q = home(robot)
    ahead = rig.view(q).left.T_root_camera
    tracker = Tracker(TrackerParams(), rig, rng)
    off = []
    radii = []
    for k in range(40):
        position = (ahead @ np.array([-0.05 + 0.008 * max(k - 10, 0), 0.02, 0.45, 1.0]))[:3]
        step = tracker.step(frame(rig, q, [Sphere(position, 0.03, color, stripes)], DT * k, rng))
        if step.track.status is Status.TRACKING:
            off.append(np.linalg.norm(step.track.position - position))
            radii.append(step.track.radius_m)
    assert len(off) > 15
    assert np.median(off) < 0.01  # of 14 px radius: a disparity of 0.7 px
    assert max(off) < 0.03
    assert np.median(radii) == pytest.approx(0.03, rel=0.1)
    assert step.followed_by == ("colour" if stripes else "background")


def test_eyes_that_look_one_after_the_other(world: BallScene, rng: np.random.Generator) -> None:
    tracker = Tracker(TrackerParams(), world.rig, rng)
    errors = []
    for k in range(18):
        early = world.frame(k, rng)
        t = DT * k + 0.02
        ball = Sphere(world.position(t), world.radius_m, world.color)
        late = frame(world.rig, world.q(t), [ball], t, rng)
        pair = StereoFrame(early.left, late.right, DT * k, t, early.joints_left_rad, late.joints_right_rad)
        track = tracker.step(pair).track
        if track.is_known:
            errors.append(track.position - world.position(track.stamp_s))
    assert len(errors) > 9
    assert _rms(np.array(errors)) < 0.004


def test_a_refused_frame_changes_nothing_and_the_next_one_is_taken(world: BallScene, rng: np.random.Generator) -> None:
    tracker = Tracker(TrackerParams(), world.rig, rng)
    good = world.frame(0, rng)
    small = np.zeros((120, 160, 3), np.uint8)
    for changes, says in (
        ({"right": small}, r"right image \(120, 160, 3\) uint8; expected \(240, 320, 3\) uint8"),
        ({"left": good.left.astype(float)}, r"left image \(240, 320, 3\) float64"),
        ({"left": good.left[..., 0]}, r"left image \(240, 320\) uint8"),
        ({"stamp_left_s": np.inf}, "left stamp inf s after -inf s"),
        ({"stamp_right_s": np.nan}, "right stamp nan s"),
        ({"joints_right_rad": np.zeros(3)}, "3"),
        ({"joints_left_rad": None}, "joints"),
    ):
        previous = tracker.state
        with pytest.raises(ValueError, match=says):
            tracker.step(replace(good, **changes))  # type: ignore[arg-type]
        assert tracker.state is previous
    assert tracker.step(good).track.status is Status.SEARCHING


@pytest.mark.parametrize("mode", ["generic", "marker"])
def test_what_one_eye_alone_sees_is_still_reported(robot: Robot, rig: StereoRig, mode: str) -> None:
    """From frame 20 the right eye no longer sees the ball."""
    rng = np.random.default_rng(5)
    world = BallScene(robot, rig, color=GREEN)
    tracker = Tracker(TrackerParams(mode=mode), rig, rng)  # type: ignore[arg-type]
    for k in range(24):
        hidden = world.frame(k, rng, visible=False).right
        step = tracker.step(replace(world.frame(k, rng), **({"right": hidden} if k >= 20 else {})))
    assert step.track.status is Status.COASTING
    assert [is_visible.camera for is_visible in step.detections] == ["left"]
    truth = rig.view(world.q(DT * 23)).left.project(world.position(DT * 23))
    np.testing.assert_allclose(step.detections[0].center_px, truth, atol=1.0)


def test_bad_input_is_named(world: BallScene, rng: np.random.Generator) -> None:
    tracker = Tracker(TrackerParams(), world.rig, rng)
    tracker.step(world.frame(3, rng, visible=False))
    with pytest.raises(ValueError, match=r"left stamp 0\.100000 s after 0\.150000 s"):
        tracker.step(world.frame(2, rng, visible=False))
    with pytest.raises(ValueError, match="'magic'"):
        TrackerParams(mode="magic")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="lost after 0"):
        TrackerParams(lost_after_s=0.0)
    with pytest.raises(ValueError, match=r"± -0\.01 s"):
        TrackerParams(stamp_error_s=-0.01)
    with pytest.raises(ValueError, match="background 0 s"):
        TrackerParams(background_memory_s=0)
    with pytest.raises(ValueError, match="a rising range"):
        StereoParams(distance_range=(2.0, 1.0))
    with pytest.raises(ValueError, match="1 particles"):
        ImageTrackerParams(particles=1)

"""Where tracking breaks: worse than anything bears, for 0.8 s, of an object tracked before and after."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from ball_scenes import Sphere
from data import SEED
from films import EVERY, FPS, ROBOT, blurred, circle, during, each, film, swaying
from judge import HONEST, Demand, check, whole

from pps_vision.experiments.films import disturbances as d
from pps_vision.experiments.films.recordings import Footage
from pps_vision.robot.silhouette import Silhouette
from pps_vision.types import Array, Image, Mask, Status, Track3D
from tracking.marker import MarkerParams
from tracking.tracker import Tracker, TrackerParams

FROM_S = 1.0
TO_S = 1.8
SECONDS = 2.5
OURS = {"ours": TrackerParams(), "ours, marker": TrackerParams("marker", marker=MarkerParams(hue_deg=0.0))}


def rng() -> np.random.Generator:
    return np.random.default_rng(SEED)


@cache
def fine() -> Footage:
    """At twice the rate, so that images of other moments are at hand."""
    return film(SECONDS, fps=FPS * EVERY)


@cache
def usual() -> Footage:
    return d.at_rate(fine(), EVERY)


def inside() -> Mask:
    return (usual().stamps_s > FROM_S - 1e-6) & (usual().stamps_s < TO_S - 1e-6)


def old() -> Mask:
    """Where there is nothing new but every sixth frame."""
    return inside() & (np.arange(len(usual().frames)) % 6 != 0)


def random(image: Image) -> Image:
    return np.random.default_rng(int(image.sum()) % 2**32).integers(0, 256, image.shape, dtype=np.uint8)


def passing(t_s: float) -> list[Sphere]:
    """A grey ball that passes before the red one, between it and the eyes."""
    view = usual().rig.view(swaying(t_s))
    eyes = 0.5 * (view.left.center + view.right.center)
    aside = view.left.T_root_camera[:3, 0]
    return [Sphere(eyes + 0.6 * (circle(t_s) - eyes) + 0.25 * (t_s - 1.4) * aside, 0.06, (110.0, 115.0, 105.0))]


@dataclass(frozen=True)
class Disturbance:
    footage: Callable[[], Footage]  # of which what lies in between is taken
    demand: Demand = Demand(from_s=FROM_S, to_s=TO_S)


def eyes(kind: d.EyeFault, in_both: bool) -> Disturbance:
    return Disturbance(lambda: d.eyes_fail(usual(), kind, inside(), in_both))


DEGRADED = Demand("degraded", FROM_S, TO_S)
DISTURBANCES: dict[str, Disturbance] = {
    "noise": Disturbance(lambda: d.noisy(usual(), 120.0, rng())),
    "darkness": Disturbance(lambda: d.exposed(usual(), lambda t: -6.0)),
    "glare": Disturbance(lambda: d.exposed(usual(), lambda t: 6.0)),
    "flicker": Disturbance(lambda: d.exposed(usual(), lambda t: 4.0 * (-1) ** round(FPS * t))),
    "blur": Disturbance(lambda: blurred(fine(), EVERY, 2 * EVERY + 1), DEGRADED),
    "grey": Disturbance(lambda: d.desaturated(usual(), 0.0)),
    "missing pairs": Disturbance(lambda: d.picked(usual(), np.flatnonzero(~old())), DEGRADED),
    "repeated pairs": Disturbance(lambda: d.eyes_fail(usual(), "frozen", old(), both=True), DEGRADED),
    "occluder": Disturbance(lambda: film(SECONDS, others=passing), DEGRADED),
    "right eye flickers": Disturbance(lambda: d.eyes_fail(usual(), "black", old()), DEGRADED),
    "right eye knocked": Disturbance(lambda: each(usual(), lambda f: replace(f, right=np.roll(f.right, -30, axis=0)))),
    "right eye sees noise": Disturbance(lambda: each(usual(), lambda f: replace(f, right=random(f.right)))),
    "one eye black": eyes("black", in_both=False),
    "both eyes black": eyes("black", in_both=True),
    "one eye frozen": eyes("frozen", in_both=False),
    "both eyes frozen": eyes("frozen", in_both=True),
}


@cache
def disturbed(how: str) -> Footage:
    return during(usual(), DISTURBANCES[how].footage(), FROM_S, TO_S)


def tracked(footage: Footage, params: TrackerParams) -> list[Track3D]:
    tracker = Tracker(params, footage.rig, rng(), own_body=Silhouette(ROBOT))
    return [tracker.step(frame).track for frame in footage.frames]


def _case(how: str, mode: str) -> object:
    """A case; where pairs are missing or repeated, or images show nothing, the mode does not matter."""
    is_repeated = mode != "ours" and any(word in how for word in ("pairs", "black", "frozen", "noise"))
    return pytest.param(how, mode, marks=[pytest.mark.long] * is_repeated)


@pytest.mark.parametrize(("how", "mode"), [_case(how, mode) for how in DISTURBANCES for mode in OURS])
def test_what_breaks_it_is_owned_to_and_got_over(how, mode):
    footage = disturbed(how)
    check(DISTURBANCES[how].demand, tracked(footage, OURS[mode]), footage.position)


def test_frames_out_of_order_are_refused_and_change_nothing():
    frames = usual().frames
    params = OURS["ours"]
    tracker, undisturbed = (Tracker(params, usual().rig, rng()) for _ in range(2))
    for k, frame in enumerate(frames[:24]):
        if k > 3:
            for wrong in (frames[k - 1], frames[k - 3], replace(frame, stamp_right_s=frames[k - 2].stamp_right_s)):
                with pytest.raises(ValueError, match="expected rising stamps"):
                    tracker.step(wrong)
        ours = tracker.step(frame).track
        theirs = undisturbed.step(frame).track
        assert ours.status == theirs.status
        np.testing.assert_array_equal(ours.mean, theirs.mean)
        np.testing.assert_array_equal(ours.cov, theirs.cov)
    assert ours.status == Status.TRACKING
    assert np.linalg.norm(ours.position - usual().position[23]) < 0.003


LEAP = Demand("degraded", FROM_S, FROM_S + 0.225, excused_s=0.075, recovered_s=0.0)


def leaping(t_s: float) -> Array:
    return circle(t_s) + np.array([0.0, 0.12 if t_s > FROM_S - 1e-6 else 0.0, 0.0])


def test_a_leap_is_caught_in_four_frames():
    """A ball that is suddenly elsewhere: not measured where it was, and found where it is."""
    footage = film(1.5, lambda _: swaying(0.0), leaping)
    check(LEAP, tracked(footage, OURS["ours"]), footage.position)


TURNS_S = 1.6, 2.4


def test_grey_eyes_that_move_keep_what_they_saw_at_rest_and_claim_nothing_wrong():
    """Images without colour: only motion tells an object, and a head that turns for a while makes everything move."""
    footage = d.desaturated(film(3.9, lambda t: swaying(np.clip(t, *TURNS_S) - TURNS_S[0])), 0.0)
    tracks = tracked(footage, OURS["ours"])
    off = [t.position - p for t, p in zip(tracks, footage.position, strict=True)]
    after = [k for k, track in enumerate(tracks) if track.stamp_s > TURNS_S[0]]
    assert all(tracks[k].status == Status.TRACKING for k in after)
    assert max(np.linalg.norm(off[k]) for k in after) < 0.04
    nees = [e @ np.linalg.solve(t.cov[:3, :3], e) for t, e in zip(tracks, off, strict=True) if t.is_known]
    assert len(nees) > 30
    assert max(nees) < HONEST


def test_stamps_said_to_be_off_widen_what_is_known_by_as_much():
    """A head pose 25 ms old: trusted, the track is surely wrong; told of 25 ms, its 3σ hold the truth."""
    footage = d.stale_joints(fine(), EVERY, 0.025)
    inside = []
    for stamp_error_s in (0.0, 0.025):
        tracks = tracked(footage, replace(OURS["ours"], stamp_error_s=stamp_error_s))[15:]
        off = [t.position - p for t, p in zip(tracks, footage.position[15:], strict=True)]
        nees = [e @ np.linalg.solve(t.cov[:3, :3], e) for t, e in zip(tracks, off, strict=True)]
        inside.append(np.mean(np.array(nees) < 14.2))  # χ², 3 degrees of freedom, 3σ
    assert inside[0] < 0.2
    assert inside[1] > 0.8


def test_a_sensor_without_noise_may_stand_still_for_a_moment():
    """Images without noise repeat while nothing moves: unseen, but not lost before its time."""
    moving = film(0.8, lambda _: swaying(0.0), noise=False)
    last = moving.frames[-1]
    still = [replace(last, stamp_left_s=0.8 + 0.05 * k, stamp_right_s=0.8 + 0.05 * k) for k in range(8)]
    tracks = tracked(replace(moving, frames=(*moving.frames, *still)), OURS["ours"])
    whole(tracks)
    assert tracks[-9].status == Status.TRACKING
    assert np.linalg.norm(tracks[-9].position - moving.position[-1]) < 0.003
    assert {track.status for track in tracks[-8:]} == {Status.COASTING}

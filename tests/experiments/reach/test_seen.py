"""Fixation through rendered eyes against the head's kinematics, and how failures are told apart."""

from collections.abc import Iterator

import numpy as np
import pytest

from control.fixation import fixation_error
from learning.babbling import gaze_at_hand, random_arms
from pps_vision.experiments.reach import seen_babbling
from pps_vision.experiments.reach.onlooker import Looked, Onlooker, OnlookerParams
from pps_vision.experiments.reach.seen_babbling import HANDS, SeenBabbling, Watching
from pps_vision.experiments.reach.seen_box import SeenBox
from pps_vision.robot.gaze import fixation_point, fixation_points
from pps_vision.robot.icub import icub_rig, load_icub, set_gaze
from rendering.eyes import Eyes
from rendering.fidelity import Fidelity
from rendering.sensor import Sensor
from rendering.stimuli import make_stimulus
from tracking.marker import MarkerParams

ROBOT = load_icub()
RIG = icub_rig(ROBOT)
AHEAD = set_gaze(ROBOT, np.zeros(ROBOT.n_joints), vergence=np.deg2rad(20))


@pytest.fixture(scope="module")
def eyes() -> Iterator[Eyes]:
    coarse = Fidelity(fineness=1)
    with Eyes(ROBOT, RIG, make_stimulus("marker", 0.02), sensor=Sensor(noise_sigma=2.0), fidelity=coarse) as eyes:
        yield eyes


def onlooker(eyes: Eyes, **params: float) -> Onlooker:
    return Onlooker(ROBOT, RIG, eyes, MarkerParams(), np.random.default_rng(1), OnlookerParams(**params))


def test_the_gaze_read_is_that_of_the_point(eyes: Eyes) -> None:
    """Out of view at first: it is looked for, found and fixated."""
    gaze = np.deg2rad([40.0, -25.0, 14.0])
    looked = onlooker(eyes).fixate(AHEAD, fixation_points(ROBOT, gaze[None])[0])
    assert looked.outcome == "fixated"
    assert looked.looks > 0
    np.testing.assert_allclose(np.rad2deg(looked.gaze_rad - gaze), 0, atol=0.1)


def test_what_the_limits_forbid_is_not_fixated(eyes: Eyes) -> None:
    """10° beyond what the neck can turn, in view of both eyes all the same; by how much it is missed is seen too."""
    aside = set_gaze(ROBOT, AHEAD, yaw=np.deg2rad(65))
    point = fixation_point(ROBOT.at(aside))
    assert point is not None
    start = set_gaze(ROBOT, AHEAD, yaw=np.deg2rad(50))
    looked = onlooker(eyes).fixate(start, point)
    assert looked.outcome == "at the limits"
    assert np.isnan(looked.gaze_rad).all()
    assert looked.off_rad > np.deg2rad(1)
    assert looked.off_rad == pytest.approx(fixation_error(ROBOT.at(looked.q_rad), point), abs=np.deg2rad(0.1))


def test_what_is_behind_is_not_found(eyes: Eyes) -> None:
    looked = onlooker(eyes, max_looks=4).fixate(AHEAD, np.array([0.5, 0.0, 0.3]))
    assert (looked.outcome, looked.looks, looked.frames) == ("not found", 4, 0)
    assert np.isnan(looked.gaze_rad).all()


def test_out_of_patience(eyes: Eyes) -> None:
    looked = onlooker(eyes, max_frames=4).fixate(AHEAD, fixation_points(ROBOT, np.deg2rad([[15.0, 0, 20]]))[0])
    assert looked.outcome == "restless"


def test_tilt_is_read_as_the_neck_pitch_that_does_the_same(eyes: Eyes) -> None:
    q = set_gaze(ROBOT, AHEAD, yaw=0.2, pitch=0.5, tilt=0.1)
    gaze = onlooker(eyes).read(q)
    meeting = fixation_point(ROBOT.at(q))
    np.testing.assert_allclose(fixation_points(ROBOT, gaze[None])[0], meeting, atol=1e-7)
    assert gaze[1] > 0.55
    assert np.isnan(onlooker(eyes).read(set_gaze(ROBOT, AHEAD, pitch=-0.6, tilt=-0.3))).all()  # −51°, J's limit is −40°


def test_a_patch_is_fixated_from_its_own_side_only() -> None:
    """Postures seen from the front and from behind, told apart by where the palm's normal points."""
    arms = random_arms(400, np.random.default_rng(5))
    gaze = gaze_at_hand(ROBOT, "right", arms)
    facing = np.full(len(arms), np.nan)
    for k in np.flatnonzero(np.isfinite(gaze).all(axis=1)):
        q = np.zeros(ROBOT.n_joints)
        q[ROBOT.indices(ROBOT.names.arm("right")[:4])] = arms[k]
        palm = ROBOT.at(q).T_root("right_palm")
        facing[k] = palm[:3, 2] @ (np.array([-0.06, 0, 0.34]) - palm[:3, 3])
    with Watching(ROBOT, HANDS["patch on the palm"], 1) as watching:
        front, behind = np.nanargmax(facing), np.nanargmin(facing)
        looked = watching.at(arms[front])
        assert looked.outcome == "fixated"
        np.testing.assert_allclose(np.rad2deg(looked.gaze_rad - gaze[front]), 0, atol=0.3)
        assert watching.cause(looked, arms[behind], gaze[behind]) == "turned away"


def test_nothing_is_dropped_and_charts_draw_it() -> None:
    def one(outcome, off):
        return Looked(outcome, AHEAD, np.deg2rad([10.0, 0, 20]) + off, 0.0, 20, 1)

    class Told:
        def cause(self, looked: Looked, *_: object) -> str:
            return {"fixated": "partly hidden", "not found": "hidden"}[looked.outcome]

    looked = [one("fixated", 0.0), one("fixated", np.deg2rad(0.4)), one("not found", np.nan)]
    numbers = seen_babbling.judged(Told(), looked, np.zeros((3, 4)), np.deg2rad([[10.0, 0, 20]] * 3))
    assert (numbers["shown"], numbers["fixated"], numbers["within_goal"]) == (3, 2, 1)
    assert numbers["not_fixated_by_cause"] == {"hidden": 1}
    assert numbers["beyond_goal_by_cause"] == {"partly hidden": 1}
    assert numbers["rmse_deg"]["pitch"] == pytest.approx(0.4 / np.sqrt(2))
    curve = {"rmse_deg": [1.0, 0.2], "unanswered": [0.5, 0.0]}
    learned = {"samples": [20, 40], "curves": {"LWPR, seen": curve, "LWPR, by kinematics": curve}}
    figures = SeenBabbling().chart({"goal_deg": 0.3, "hands": dict.fromkeys(HANDS, numbers), "learned": learned})
    widths = sum(bar.get_width() for bar in figures[""].axes[0].patches)
    assert widths == pytest.approx(100 * len(HANDS))
    where = {"p_root_m": [[-0.3, 0, 0.2]] * 3, "reachable": [True, False, True], "said": [True, True, None]}
    legend = SeenBox().chart({"locations": where}).legends[0]
    assert [text.get_text().rsplit(": ", 1)[1] for text in legend.get_texts()] == ["1", "0", "1", "0", "1"]


def test_bad_input_is_named() -> None:
    with pytest.raises(ValueError, match="--n 20, --n-others 21"):
        SeenBabbling(n=20, n_others=21).run()
    with pytest.raises(ValueError, match="--n 3"):
        SeenBox(n=3).run()

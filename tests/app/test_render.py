"""What is rendered, before it is: options, the robot's own motion, the object's path; and what is written of it."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from control.fixation import fixation_error
from pps_vision.app.render import _before_the_eyes, record, scene, stimulus_of
from pps_vision.app.render_params import RenderParams
from pps_vision.errors import InputError
from pps_vision.recordings.robot_file import robot_setup
from rendering.scene import SceneState

SETUP = robot_setup(None)


def states(seed: int = 1, **options: object) -> list[tuple[float, SceneState]]:
    asked = {"stimulus": "ball", "motion": "circle", "out": Path("never"), "seconds": 0.5, "fps": 10.0} | options
    return list(scene(RenderParams(**asked), SETUP, np.random.default_rng(seed)))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        *(
            ({"seconds": s}, f"--seconds {s}, --fps 20.0; expected positive numbers")
            for s in (0.0, -1.0, np.inf, np.nan)
        ),
        *(({"fps": f}, f"--seconds 5.0, --fps {f}; expected positive numbers") for f in (0.0, np.inf, np.nan)),
        *(({"radius": r}, f"--radius {r} m; expected above 0 and at most 0.3") for r in (0.0, 0.31, np.nan)),
        ({"center": (0.0, np.nan, 0.0)}, "expected three numbers in metres"),
        ({"stimulus": Path("a.obj.txt")}, "--stimulus a.obj.txt; expected one of "),
    ],
)
def test_options_out_of_their_range_are_refused(options: dict[str, object], said: str, tmp_path: Path) -> None:
    asked = {"stimulus": "ball", "motion": "circle", "out": tmp_path / "out"} | options
    with pytest.raises(InputError) as refused:
        record(RenderParams(**asked))  # type: ignore[arg-type]
    assert said in str(refused.value)
    assert not (tmp_path / "out").exists()


def test_an_object_has_the_radius_asked_for() -> None:
    asked = RenderParams("cube", "circle", Path("never"), radius=0.02)
    assert (stimulus_of(asked, 0).name, stimulus_of(asked, 0).radius_m) == ("cube", 0.02)


def test_frames_come_at_the_rate_and_for_the_time_asked_for() -> None:
    assert [t for t, _ in states()] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert [t for t, _ in states(seconds=0.01)] == [0.0], "at least one"


@pytest.mark.parametrize("fps", [5.0, 20.0])
def test_the_eyes_follow_the_object_while_the_head_sways(fps: float) -> None:
    """They begin on it; joints move on by their rates, and the object by its velocity."""
    found = states(seconds=2.0, fps=fps, speed=0.1)
    errors = [fixation_error(SETUP.robot.at(state.q_rad), state.position) for _, state in found]
    assert errors[0] < 1e-3
    assert np.rad2deg(max(errors)) < (1.5 if fps == 20 else 5)
    for (_, one), (_, following) in pairwise(found):
        assert one.dq_rad_s is not None
        np.testing.assert_allclose(following.q_rad, SETUP.robot.clamp(one.q_rad + one.dq_rad_s / fps), atol=1e-12)
        assert one.position is not None
        np.testing.assert_allclose(following.position, one.position + one.velocity / fps, atol=0.1 / fps)
    q = np.array([state.q_rad for _, state in found])
    assert np.ptp(q[:, SETUP.robot.indices(("neck_yaw",))[0]]) > np.deg2rad(3)


def test_a_head_that_is_still_does_not_move() -> None:
    found = states(head="still", center=(-0.4, 0.0, 0.25), seconds=0.3)
    assert all((state.q_rad == found[0][1].q_rad).all() and not state.dq_rad_s.any() for _, state in found)  # type: ignore[union-attr]


def test_a_motion_is_about_a_point_33_to_52_cm_before_the_eyes() -> None:
    """Before the middle between the iCub's eyes, to either side by 15°, 25° down to 5° up; x is backwards."""
    view, rng = SETUP.rig.view(SETUP.home_rad), np.random.default_rng(0)
    ahead = np.array([_before_the_eyes(rng) for _ in range(400)]) - 0.5 * (view.left.center + view.right.center)
    distance = np.linalg.norm(ahead, axis=1)
    azimuth = np.rad2deg(np.arctan2(ahead[:, 1], -ahead[:, 0]))
    elevation = np.rad2deg(np.arcsin(ahead[:, 2] / distance))
    for found, (low, high) in ((distance, (0.33, 0.52)), (azimuth, (-15, 15)), (elevation, (-25, 5))):
        assert found.min() == pytest.approx(low, abs=0.02 * (high - low))
        assert found.max() == pytest.approx(high, abs=0.02 * (high - low))

"""The loop closed on rendered eyes: an episode of every kind after a short training."""

from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest
from data import SEED
from known_track import frame_at

from control.fixation import fixation_error
from learning.pps.memory import PPSMemory
from pps_vision.app.simulation import (
    Episode,
    SimulationScene,
    make_episode,
    open_scene,
    own_rate,
    simulate,
    train,
)
from pps_vision.errors import InputError
from pps_vision.experiments.loop import Loop
from pps_vision.robot.icub import icub_setup
from pps_vision.robot.skin import TOUCH_RADIUS_M, icub_skin
from pps_vision.types import StereoFrame
from rendering.scene import SceneState
from rendering.stimuli import Stimulus, make_stimulus

LOOP = Loop(n=1, seed=SEED)
LONG = [pytest.param(case, marks=pytest.mark.long) for case in ("avoidance off", "static", "own arm")]


@pytest.fixture(scope="module")
def scene() -> Iterator[SimulationScene]:
    with open_scene(noise_sigma=2.0, seed=LOOP.seed) as scene:
        yield scene


@pytest.fixture(scope="module")
def memory(scene: SimulationScene) -> PPSMemory:
    return train(scene, trials=2)


def test_every_inner_taxel_has_learned(memory):
    inner = [i for i, name in enumerate(memory.taxel_ids) if name.startswith("left_forearm")][:8]
    assert (memory.samples[inner, 0] > 0).all()


@pytest.mark.parametrize("case", ["avoidance on", "receding", *LONG])
def test_episodes(scene, memory, case):
    log = LOOP.episode(scene, memory, case, 0)
    assert log.was_touched == (case == "avoidance off")
    assert log.was_commanded == log.speed_m_s.any() == (case == "avoidance on")
    np.testing.assert_array_equal(log.touched, log.surface_gap_m <= TOUCH_RADIUS_M)
    if case != "own arm":
        assert np.isfinite(log.track_m[20:, 0]).mean() > 0.9
        assert 1e-4 < np.nanmedian(log.track_std_m) < 0.02  # before the arm, which might hide parts of it
        assert np.nanmedian(np.linalg.norm(log.track_m - log.truth_m, axis=1)) < 0.02
    np.testing.assert_allclose(log.q_rad, scene.robot.clamp(log.q_rad), atol=1e-9)


@pytest.mark.parametrize(
    ("avoid", "own_motion", "arm_obeys"),
    [(True, "", True), (False, "", False), (True, "arm", False), (True, "head", True)],
)
def test_the_robot_moves_by_its_commands_and_its_own_motion(scene, avoid, own_motion, arm_obeys):
    """All joints are commanded 0.02 rad/s; an arm that does not obey or swings by itself ignores them."""
    command = SimpleNamespace(command=SimpleNamespace(dq_rad_s=np.full(scene.robot.n_joints, 0.02)))
    episode = Episode("", "ball", None, 0.2, own_motion)
    steps = list(simulate(scene, episode, lambda frame, touched: command, avoid))
    assert len(steps) == 4
    q = scene.home
    for k, step in enumerate(steps):
        np.testing.assert_allclose(step.q_rad, q, atol=1e-12)
        np.testing.assert_allclose(step.frame.joints_left_rad, q, atol=1e-12)
        assert step.frame.stamp_s == pytest.approx(0.05 * k)
        assert np.isnan(step.position).all()
        assert not step.touched.any()
        commanded = np.full(len(q), 0.02)
        commanded[scene.arm] *= arm_obeys
        q = q + 0.05 * (commanded + own_rate(scene.robot, own_motion, scene.arm, 0.05 * k))


class NoEyes:
    """In place of rendered eyes: records the states, returns black images."""

    def __init__(self) -> None:
        self.shown: list[tuple[Stimulus, SceneState, float]] = []

    def set_stimulus(self, stimulus: Stimulus) -> None:
        self.stimulus = stimulus

    def render(self, state: SceneState, t: float, rng: np.random.Generator) -> StereoFrame:
        self.shown.append((self.stimulus, state, t))
        return frame_at(t, state.q_rad)


@pytest.fixture
def unseen() -> SimulationScene:
    """A scene that nobody renders."""
    setup = icub_setup(icub_skin(("left_forearm", "left_palm")))
    return SimulationScene(setup, NoEyes(), np.random.default_rng(0), "left")


def test_an_episode_begins_with_the_eyes_on_its_object_and_shows_it_where_it_is(unseen):
    """A cube that comes to the skin in 1 s: it touches the taxels within 20 mm of its surface."""
    index = unseen.skin.index("left_forearm:3")
    way = np.array([0.05, -0.05, -0.1])
    begin = unseen.skin.at(unseen.robot.at(unseen.home))[0][index] - way
    episode = Episode("", "cube", lambda t: (begin + t * way, way), 1.0)
    still = SimpleNamespace(command=SimpleNamespace(dq_rad_s=np.zeros(unseen.robot.n_joints)))
    steps = list(simulate(unseen, episode, lambda frame, touched: still))
    assert fixation_error(unseen.robot.at(steps[0].q_rad), begin) < 1e-3
    shown = unseen.eyes.shown
    cube = make_stimulus("cube")
    assert [t for _, _, t in shown] == pytest.approx(np.arange(20) / 20)
    for (stimulus, state, t), step in zip(shown, steps, strict=True):
        assert (stimulus.name, stimulus.radius_m) == (cube.name, cube.radius_m)
        np.testing.assert_array_equal(state.position, begin + t * way)
        np.testing.assert_array_equal(step.position, begin + t * way)
        gaps = np.linalg.norm(step.taxels - step.position, axis=1) - cube.radius_m
        assert step.touched.tolist() == (gaps <= 0.02).tolist()
    assert not steps[0].touched.any()
    assert steps[-1].touched[index]


@pytest.mark.parametrize(("kind", "gap_m"), [("approach", 0.017), ("recede", 0.030)])
def test_an_approach_touches_and_what_recedes_does_not(unseen, kind, gap_m):
    """The surface comes within 17 mm of a taxel, 20 being a touch, or begins 30 mm from one; both rest for the last
    half second where an approach begins."""
    episode = make_episode(kind, unseen, "left_forearm:3", "octopus", np.random.default_rng(1), 0.1)
    times = np.append(np.arange(0, episode.seconds, 0.001), episode.seconds)
    taxels = unseen.skin.at(unseen.robot.at(unseen.home))[0]
    points = np.array([episode.motion(t)[0] for t in times])
    gaps = np.linalg.norm(points[:, None] - taxels, axis=2) - make_stimulus(episode.stimulus).radius_m
    assert gaps.min() == pytest.approx(gap_m, abs=1e-4)
    resting = times[(points == points[-1]).all(axis=1) & (times > 1)]
    assert episode.seconds - resting[0] == pytest.approx(0.5, abs=0.002)
    assert gaps[-1].min() > 0.1
    assert gaps[0].min() == pytest.approx(gaps.min() if kind == "recede" else gaps[-1].min(), abs=1e-4)


@pytest.mark.parametrize(
    ("kind", "reach_m", "message"),
    [
        ("approach", 1.5, r"to stop 1\.5\d* m from it; expected a smaller object or reach"),
        ("recede", 0.01, "no recede about left_forearm:3 stays in view of both eyes; expected a taxel"),
    ],
)
def test_episodes_that_cannot_be_are_refused(unseen, kind, reach_m, message):
    with pytest.raises(InputError, match=message):
        make_episode(kind, unseen, "left_forearm:3", "ball", np.random.default_rng(0), 0.1, reach_m=reach_m)

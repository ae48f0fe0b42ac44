"""The loop closed on rendered eyes: an episode of every kind after a short training."""

from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest
from data import SEED

from learning.pps.memory import PPSMemory
from pps_vision.app import simulation
from pps_vision.app.simulation import (
    Episode,
    OwnMotion,
    World,
    first_contact,
    make_episode,
    open_world,
    own_rate,
    simulate,
    train,
)
from pps_vision.errors import InputError
from pps_vision.experiments.loop import Loop, LoopCase
from pps_vision.robot.skin import TOUCH_RADIUS_M
from rendering.stimuli import make_stimulus

LOOP = Loop(n=1, seed=SEED)


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    with open_world(noise_sigma=2.0, seed=LOOP.seed) as world:
        yield world


@pytest.fixture(scope="module")
def memory(world: World) -> PPSMemory:
    return train(world, trials=3)


def test_every_inner_taxel_has_learned(memory: PPSMemory) -> None:
    inner = [i for i, name in enumerate(memory.taxel_ids) if name.startswith("left_forearm")][:8]
    assert (memory.counts[inner, ..., 0].sum(axis=(1, 2)) > 0).all()


@pytest.mark.parametrize(
    ("case", "touched", "commanded"),
    [
        ("avoidance on", False, True),
        ("avoidance off", True, False),
        ("receding", False, False),
        ("static", False, False),
        ("own arm", False, False),
    ],
)
@pytest.mark.parametrize("number", range(LOOP.n))
def test_episodes(world: World, memory: PPSMemory, case: LoopCase, touched: bool, commanded: bool, number: int) -> None:
    log = LOOP.episode(world, memory, case, number)
    print(f"seed {LOOP.seed}, {case} {number}: gap {1000 * np.nanmin([np.inf, *log.surface_gap_m.min(1)]):.0f} mm")
    assert log.was_touched == touched
    assert log.was_commanded == commanded
    assert log.speed_m_s.any() == commanded
    np.testing.assert_array_equal(log.touched, log.surface_gap_m <= TOUCH_RADIUS_M)
    if case != "own arm":
        assert np.isfinite(log.track_m[20:, 0]).mean() > 0.9
        assert 1e-4 < np.nanmedian(log.track_std_m) < 0.01
    limits = world.robot.lower_rad - 1e-9, world.robot.upper_rad + 1e-9
    assert ((log.q_rad >= limits[0]) & (log.q_rad <= limits[1])).all()


def test_what_it_starts_beside_is_passed() -> None:
    target, beside = np.zeros(3), np.array([0.0, 0.03, 0.25])
    start = np.array([0.0, 0.0, 0.26])
    assert first_contact(start, target, np.stack([target, beside]), 0.05) == pytest.approx([0, 0, 0.05])


def test_first_contact_is_where_the_reach_is_met() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        taxels = rng.normal(0, 0.02, (8, 3))
        start = taxels[0] + 0.28 * np.array([0.0, 0.6, 0.8])
        reach = 0.035 + TOUCH_RADIUS_M
        end = first_contact(start, taxels[0], taxels, reach)
        gaps = np.linalg.norm(taxels - end, axis=1)
        assert gaps.min() == pytest.approx(reach)
        way = np.linspace(0, 1, 500)[:, None]
        before = start + way * (end - start)
        assert np.linalg.norm(before[:, None] - taxels, axis=2).min() >= reach - 1e-9


def test_a_reach_beyond_the_start_of_an_approach_is_refused(world: World) -> None:
    with pytest.raises(InputError, match=r"to stop 1\.5\d* m from it; expected a smaller object or reach"):
        make_episode("approach", world, "left_forearm:3", "ball", np.random.default_rng(SEED), 0.1, reach_m=1.5)


def test_a_training_episode_ends_0_7_s_after_the_touch(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is touched from 2.5 s on, in frames 50 ms apart; the withdrawal, 3 s after, is not learned from."""
    empty, frames = PPSMemory.empty(world.skin), []

    def simulated(*_: object, **__: object) -> Iterator[SimpleNamespace]:
        for k in range(120):
            frames.append(k)
            yield SimpleNamespace(touched=np.array([False, 50 <= k < 110]))

    monkeypatch.setattr(simulation, "simulate", simulated)
    pipeline = SimpleNamespace(step=None, finish=lambda: empty)
    monkeypatch.setattr(simulation, "new_pipeline", lambda *_: pipeline)
    assert train(world, trials=1) is empty
    assert frames == list(range(50 + 14))


def test_near_misses_come_between_the_touches(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    """One in three touches; the others come as near as 4–16 cm, and then the episode ends."""
    nearest_m: list[float] = []
    learned: list[str] = []

    def moved(world: World, episode: Episode, *_: object, **__: object) -> Iterator[SimpleNamespace]:
        times = np.linspace(0, episode.seconds, 400)
        taxels, _ = world.skin.at(world.robot.at(world.home))
        points = np.array([episode.motion(t)[0] for t in times])  # type: ignore[misc]
        gaps = np.linalg.norm(points[:, None] - taxels, axis=2).min(axis=1) - make_stimulus(episode.stimulus).radius_m
        nearest_m.append(float(gaps.min()))
        assert np.argmin(gaps) == 399 or gaps.min() < TOUCH_RADIUS_M
        return iter(())

    names = {one: lambda one=one: learned.append(one) for one in ("finish", "miss")}
    monkeypatch.setattr(simulation, "simulate", moved)
    monkeypatch.setattr(simulation, "new_pipeline", lambda *_: SimpleNamespace(step=None, **names))
    train(world, trials=24, touch_every=3)
    assert learned == ["finish", "miss", "miss"] * 8
    touching, missing = np.array(nearest_m)[::3], np.delete(nearest_m, slice(None, None, 3))
    assert (np.abs(touching) < 1e-3).all()
    assert 0.04 <= missing.min() < 0.07
    assert 0.13 < missing.max() <= 0.16 + 1e-9


@pytest.mark.parametrize(
    ("avoid", "own_motion", "arm_obeys"),
    [(True, "", True), (False, "", False), (True, "arm", False), (True, "head", True)],
)
def test_the_robot_moves_by_its_commands_and_its_own_motion(
    world: World, avoid: bool, own_motion: OwnMotion, arm_obeys: bool
) -> None:
    """All joints are commanded 0.02 rad/s; of an arm that does not obey, or swings by itself, the command is void."""
    command = SimpleNamespace(command=SimpleNamespace(dq_rad_s=np.full(world.robot.n_joints, 0.02)))
    episode = Episode("", "ball", None, 0.2, own_motion)
    steps = list(simulate(world, episode, lambda frame, touched: command, avoid))  # type: ignore[arg-type,return-value]
    assert len(steps) == 4
    q = world.home
    for k, step in enumerate(steps):
        np.testing.assert_allclose(step.q_rad, q, atol=1e-12)
        np.testing.assert_allclose(step.frame.joints_left_rad, q, atol=1e-12)
        assert step.frame.stamp_s == pytest.approx(0.05 * k)
        assert np.isnan(step.position).all()
        assert not step.touched.any()
        commanded = np.full(len(q), 0.02)
        commanded[world.arm] *= arm_obeys
        q = q + 0.05 * (commanded + own_rate(world.robot, own_motion, world.arm, 0.05 * k))

"""The closed loop when an eye fails for a while in the middle of an approach.

What the tracker alone owes is in `test_past_the_break`; here a head and an arm move by what it says.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from data import SEED

from learning.pps.memory import PPSMemory
from pps_vision.app.simulation import (
    EpisodeLog,
    SimulationScene,
    log_of,
    make_episode,
    new_pipeline,
    open_scene,
    simulate,
)
from pps_vision.types import Image, Status, StereoFrame

FAILS_S = 1.5
RECOVERS_S = 2.65
LOST_WITHIN_S = 0.6
Fault = Callable[[StereoFrame, StereoFrame], StereoFrame]  # present frame, last good frame → frame with the fault
Met = Callable[[str], EpisodeLog]


class FaultyEyes:
    """Eyes that do not work from `FAILS_S` to `RECOVERS_S`."""

    def __init__(self, eyes, fault: Fault) -> None:
        self.eyes = eyes
        self.fault = fault
        self.good: StereoFrame | None = None

    def set_stimulus(self, stimulus) -> None:
        self.eyes.set_stimulus(stimulus)

    def render(self, state, stamp_s: float, rng) -> StereoFrame:
        frame = self.eyes.render(state, stamp_s, rng)
        if stamp_s < FAILS_S or stamp_s >= RECOVERS_S:
            self.good = frame
            return frame
        return self.fault(frame, self.good)


def black(image: Image) -> Image:
    return np.zeros_like(image)


FAULTS: dict[str, Fault] = {
    "both eyes black": lambda present, good: replace(present, left=black(present.left), right=black(present.right)),
    "both eyes frozen": lambda present, good: replace(present, left=good.left, right=good.right),
    "one eye black": lambda present, good: replace(present, right=black(present.right)),
    "one eye frozen": lambda present, good: replace(present, right=good.right),
    "one eye sees noise": lambda present, good: replace(
        present,
        right=np.random.default_rng(int(1000 * present.stamp_s)).integers(0, 256, present.right.shape, dtype=np.uint8),
    ),
}


@pytest.fixture(scope="module")
def scene() -> Iterator[SimulationScene]:
    with open_scene(noise_sigma=2.0, seed=SEED) as scene:
        yield scene


def anxious(scene: SimulationScene) -> PPSMemory:
    """A skin that has been touched by everything that came near."""
    return PPSMemory.constant(scene.skin)


def meet(scene: SimulationScene, fault: Fault) -> EpisodeLog:
    faulty = replace(scene, eyes=FaultyEyes(scene.eyes, fault))
    rng = np.random.default_rng(SEED)
    episode = make_episode("approach", faulty, "left_forearm:3", "ball", rng, speed_m_s=0.05)
    episode = replace(episode, seconds=3.5)
    rows = list(simulate(faulty, episode, new_pipeline(faulty, anxious(faulty)).step))
    for step in (row.step for row in rows):
        assert np.all(np.isfinite(step.command.dq_rad_s))
        assert np.all(np.isfinite(step.activation.probability))
        if step.tracking.track.is_known:
            assert np.linalg.eigvalsh(step.tracking.track.cov[:3, :3]).min() > 0
        else:
            assert step.activation.probability.max() == 0, "nothing is expected of an object that is not known"
    return log_of(faulty, episode, rows)


@pytest.fixture(scope="module")
def met(scene: SimulationScene) -> Met:
    """One run of the loop with each fault."""
    return cache(lambda fault: meet(scene, FAULTS[fault]))


LONG = "both eyes black", "one eye black", "one eye frozen"


@pytest.mark.parametrize(
    "fault", [pytest.param(fault, marks=[pytest.mark.long] if fault in LONG else []) for fault in FAULTS]
)
def test_the_object_is_given_up_found_again_and_nothing_is_commanded_in_between(scene, met, fault):
    log = met(fault)
    status = np.array(log.status)
    error = np.linalg.norm(log.track_m - log.truth_m, axis=1)
    for period in ((log.stamps_s > FAILS_S - 0.3) & (log.stamps_s < FAILS_S), log.stamps_s > RECOVERS_S + 0.6):
        assert (status[period] == Status.TRACKING).all()
        assert error[period].max() < 0.01
    lost = (log.stamps_s > FAILS_S + LOST_WITHIN_S) & (log.stamps_s < RECOVERS_S)
    assert not np.isin(status[lost], ["tracking", "coasting"]).any()
    assert log.speed_m_s[lost & (log.stamps_s > FAILS_S + LOST_WITHIN_S + 0.35)].max() == 0
    limits = scene.robot.lower_rad - 1e-9, scene.robot.upper_rad + 1e-9
    assert ((log.q_rad >= limits[0]) & (log.q_rad <= limits[1])).all()


def test_the_head_does_not_spin_after_a_frozen_image(scene, met):
    """What rests in a frozen image seems to turn with the head: whoever believes it turns on for ever."""
    log = met("both eyes frozen")
    gaze = np.rad2deg(log.q_rad[:, scene.robot.indices(scene.robot.names.gaze_joints)])
    gaze_before = gaze[np.searchsorted(log.stamps_s, FAILS_S) - 1]
    until_lost = gaze[(log.stamps_s >= FAILS_S) & (log.stamps_s <= FAILS_S + LOST_WITHIN_S)]
    assert np.abs(until_lost - gaze_before).max() < 10
    assert np.abs(gaze[log.stamps_s < RECOVERS_S] - gaze_before).max() < 60, "nor does the search go round"

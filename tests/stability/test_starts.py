"""The start of a track: position and velocity are off as far as their covariances state."""

import itertools

import numpy as np
import pytest

from learning.pps.memory import PPSMemory
from pps_vision.app.simulation import SPEED_M_S, Kind, make_episode, new_pipeline, open_scene, simulate
from pps_vision.experiments.study import NOISE_SIGMA
from pps_vision.robot.skin import INNER_FOREARM
from pps_vision.types import Array
from rendering.names import StimulusName

KINDS: tuple[Kind, ...] = ("recede", "static", "approach")
STIMULI: tuple[StimulusName, ...] = ("octopus", "ball", "cube")
FRAMES = 10


def nees_of_starts(n: int, seed: int, stimuli: tuple[StimulusName, ...]) -> Array:
    """(n, FRAMES, 2) NEES of position and velocity, 3 degrees of freedom each, in the first frames of `n` tracks.

    NaN for velocity in the two frames after the object stops, as in `bench tracking`: no filter knows before that it
    does.
    """
    nees = np.full((n, FRAMES, 2), np.nan)
    cases = itertools.cycle(itertools.product(KINDS, stimuli))
    with open_scene(NOISE_SIGMA, seed) as scene:
        for k, (kind, stimulus) in enumerate(itertools.islice(cases, n)):
            rng = np.random.default_rng((seed, k))
            taxel = f"left_forearm:{INNER_FOREARM[k % len(INNER_FOREARM)]}"
            episode = make_episode(kind, scene, taxel, stimulus, rng, rng.uniform(*SPEED_M_S))
            velocities = []
            known = 0
            for step in simulate(scene, episode, new_pipeline(scene, PPSMemory.empty(scene.skin)).step):
                track = step.step.tracking.track
                velocities.append(episode.motion(step.frame.stamp_s)[1])
                if track.is_known:
                    off = track.position - step.position, track.velocity - velocities[-1]
                    covs = track.cov[:3, :3], track.cov[3:6, 3:6]
                    nees[k, known] = [e @ np.linalg.solve(cov, e) for e, cov in zip(off, covs, strict=True)]
                    if np.ptp(velocities[-3:], axis=0).any():
                        nees[k, known, 1] = np.nan
                    known += 1
                if known == FRAMES:
                    break
    return nees


@pytest.mark.long
def test_of_200_starts_the_mean_squared_errors_are_those_stated():
    position, velocity = np.moveaxis(nees_of_starts(216, 6201, STIMULI), -1, 0)
    assert 2.5 < np.nanmean(position) < 3.5
    assert 2.5 < np.nanmean(velocity) < 3.5

"""The same encounters through rendered eyes and the whole pipeline."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pps_vision.app.encounters.encounter import Arena, Encounter
from pps_vision.app.encounters.kinematic import Outcome, Watch
from pps_vision.app.encounters.tracks import TrackError, measured_error
from pps_vision.app.encounters.training import Memories
from pps_vision.app.simulation import Episode, World, new_pipeline, simulate
from pps_vision.robot.icub import icub_setup
from rendering.eyes import Eyes
from rendering.fidelity import Fidelity
from rendering.sensor import Sensor
from rendering.stimuli import make_stimulus

NAME = "ours, rendered"
_EXPOSURE = (0.5, 1.4)  # gains of the sensor


@dataclass(frozen=True)
class Seen:
    """A rendered encounter, and how the object was tracked until the would-be contact or the end."""

    outcome: Outcome
    """What became of it."""
    known: float
    """Share of the frames with a track."""
    first_s: float
    """When the track was first known; inf if never."""
    error_m: float
    """RMS error of the track; NaN without one."""
    observed: TrackError
    """Errors of the triangulated positions; NaN without one."""


def meet_rendered(arena: Arena, memories: Memories, encounter: Encounter, noise_sigma: float, seed: int) -> Seen:
    """Return what becomes of an encounter with the pipeline, from what the eyes see; it ends with the first touch.

    `noise_sigma`: pixel noise, grey levels of 255.
    """
    watch, arm = Watch(arena, encounter), arena.arm(encounter.side)
    episode = Episode(
        encounter.condition, encounter.stimulus, encounter.motion, encounter.seconds, encounter.own_motion
    )
    errors: list[float] = []
    observed, lines = [], []
    known: list[bool] = []
    first_s = np.inf
    with open_encounter(arena, encounter, noise_sigma, seed, lit=True) as world:
        steps = simulate(world, episode, new_pipeline(world, memories.of_both).step)
        for now, later in pairwise(steps):
            t, track = now.frame.stamp_s, now.step.tracking.track
            watch.posture(now.q_rad)
            watch.command(t, now.step.command.dq_rad_s, arm)
            watch.move(t, now.taxels, later.taxels)
            if t <= min(encounter.contact_s, encounter.seconds):
                known.append(track.is_known)
                seen = now.step.tracking.observation
                observed.append(np.full(3, np.nan) if seen is None else seen.p_root - now.position)
                lines.append(now.position - now.step.tracking.midpoint_root)
                if track.is_known:
                    first_s = min(first_s, t)
                    errors.append(float(np.sum((track.position - now.position) ** 2)))
            if watch.touched_part:
                break
    rms = float(np.sqrt(np.mean(errors))) if errors else np.nan
    found = TrackError((np.nan, np.nan), (np.nan, np.nan))
    if errors:
        found = measured_error(np.array(observed), lines / np.linalg.norm(lines, axis=1, keepdims=True))
    return Seen(watch.outcome(NAME), float(np.mean(known)), first_s, rms, found)


@contextmanager
def open_encounter(
    arena: Arena, encounter: Encounter, noise_sigma: float, seed: int, lit: bool = False
) -> Iterator[World]:
    """The simulation's world with the encounter's posture as home, and its arm as the one that avoids.

    `lit`: as bright as drawn, by turns in diffuse light and with the highlights of lamps.
    """
    setup = replace(icub_setup(arena.skins[encounter.side]), home_rad=encounter.q_rad)
    rng = np.random.default_rng((seed, 2))
    exposure = float(np.exp(rng.uniform(*np.log(_EXPOSURE)))) if lit else 1.0
    fidelity = Fidelity(lighting="lights" if lit and seed % 2 else "baked")
    sensor = Sensor(noise_sigma=noise_sigma, exposure=exposure)
    with Eyes(setup.robot, setup.rig, make_stimulus(encounter.stimulus), sensor=sensor, fidelity=fidelity) as eyes:
        yield World(setup, eyes, np.random.default_rng(seed), encounter.side)

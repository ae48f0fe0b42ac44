"""The same encounters through rendered eyes and the whole pipeline."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pps_vision.app.encounters.encounter import Encounter, EncounterScene
from pps_vision.app.encounters.kinematic import EncounterMonitor, EncounterResult
from pps_vision.app.encounters.tracks import TrackError, measured_error
from pps_vision.app.encounters.training import Memories
from pps_vision.app.simulation import Episode, SimulationScene, new_pipeline, simulate
from pps_vision.robot.icub import icub_setup
from pps_vision.types import Array
from rendering.eyes import Eyes
from rendering.fidelity import Fidelity
from rendering.sensor import Sensor
from rendering.stimuli import make_stimulus

NAME = "ours, rendered"
_EXPOSURE = (0.5, 1.4)  # gains of the sensor


@dataclass(frozen=True)
class RenderedResult:
    """A rendered encounter, and the quality of the track until the would-be contact or the end."""

    result: EncounterResult  # outcome of the encounter
    tracked_share: float  # share of the frames with a track
    first_s: float  # time of the first track; inf without one
    error_m: float  # RMS error of the track; NaN without one
    observed: TrackError  # errors of the triangulated positions; NaN without one


def render_encounter(
    scene: EncounterScene, memories: Memories, encounter: Encounter, noise_sigma: float, seed: int
) -> RenderedResult:
    """Run an encounter with the pipeline on rendered images, with pixel noise (grey levels of 255), until the first
    touch."""
    monitor = EncounterMonitor(scene, encounter)
    arm = scene.arm(encounter.side)
    episode = Episode(
        encounter.condition, encounter.stimulus, encounter.motion, encounter.seconds, encounter.own_motion
    )
    squared_errors: list[float] = []
    observed: list[Array] = []
    lines_of_sight: list[Array] = []
    is_tracked: list[bool] = []
    first_s = np.inf
    with open_encounter(scene, encounter, noise_sigma, seed, lit=True) as simulation:
        steps = simulate(simulation, episode, new_pipeline(simulation, memories.of_both).step)
        for step, later in pairwise(steps):
            t = step.frame.stamp_s
            track = step.step.tracking.track
            monitor.add_posture(step.q_rad)
            monitor.add_command(t, step.step.command.dq_rad_s, arm)
            monitor.add_motion(t, step.taxels, later.taxels)
            if t <= min(encounter.contact_s, encounter.seconds):
                is_tracked.append(track.is_known)
                observation = step.step.tracking.observation
                observed.append(np.full(3, np.nan) if observation is None else observation.p_root - step.position)
                lines_of_sight.append(step.position - step.step.tracking.midpoint_root)
                if track.is_known:
                    first_s = min(first_s, t)
                    squared_errors.append(float(np.sum((track.position - step.position) ** 2)))
            if monitor.touched_part:
                break
    error_m = float(np.sqrt(np.mean(squared_errors))) if squared_errors else np.nan
    error = TrackError((np.nan, np.nan), (np.nan, np.nan))
    if squared_errors:
        lines = np.array(lines_of_sight)
        error = measured_error(np.array(observed), lines / np.linalg.norm(lines, axis=1, keepdims=True))
    return RenderedResult(monitor.result(NAME), float(np.mean(is_tracked)), first_s, error_m, error)


@contextmanager
def open_encounter(
    scene: EncounterScene, encounter: Encounter, noise_sigma: float, seed: int, lit: bool = False
) -> Iterator[SimulationScene]:
    """The simulation's scene with the encounter's posture as home, and its arm as the one that avoids.

    `lit`: as bright as drawn, by turns in diffuse light and with the highlights of lamps.
    """
    setup = replace(icub_setup(scene.skins[encounter.side]), home_rad=encounter.q_rad)
    rng = np.random.default_rng((seed, 2))
    exposure = float(np.exp(rng.uniform(*np.log(_EXPOSURE)))) if lit else 1.0
    fidelity = Fidelity(lighting="lights" if lit and seed % 2 else "baked")
    sensor = Sensor(noise_sigma=noise_sigma, exposure=exposure)
    with Eyes(setup.robot, setup.rig, make_stimulus(encounter.stimulus), sensor=sensor, fidelity=fidelity) as eyes:
        yield SimulationScene(setup, eyes, np.random.default_rng(seed), encounter.side)

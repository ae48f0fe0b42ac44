"""The same encounters through rendered eyes and the whole pipeline."""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise

import numpy as np

from learning.pps.memory import PPSMemory
from pps_vision.app.encounters.encounter import Encounter, EncounterScene
from pps_vision.app.encounters.kinematic import EncounterMonitor, EncounterResult
from pps_vision.app.simulation import Episode, SimulationScene, new_pipeline, simulate
from rendering.eyes import Eyes
from rendering.fidelity import Fidelity
from rendering.sensor import Sensor
from rendering.stimuli import make_stimulus

_EXPOSURE = (0.5, 1.4)  # gains of the sensor


def render_encounter(
    scene: EncounterScene,
    memory: PPSMemory,
    encounter: Encounter,
    noise_sigma: float,
    seed: int,
) -> EncounterResult:
    """Run an encounter with the pipeline on rendered images, with pixel noise (grey levels of 255), until the first
    touch."""
    monitor = EncounterMonitor(scene, encounter)
    arm = scene.arm(encounter.side)
    motion = encounter.motion, encounter.seconds, encounter.own_motion
    episode = Episode(encounter.condition, encounter.stimulus, *motion)
    with _opened(scene, encounter, noise_sigma, seed) as simulation:
        steps = simulate(simulation, episode, new_pipeline(simulation, memory).step)
        for step, later in pairwise(steps):
            t = step.frame.stamp_s
            monitor.add_posture(step.q_rad)
            monitor.add_command(t, step.step.command.dq_rad_s, arm)
            monitor.add_motion(t, step.taxels, later.taxels)
            if monitor.touched_part:
                break
    return monitor.result("ours, rendered")


@contextmanager
def _opened(scene: EncounterScene, encounter: Encounter, noise_sigma: float, seed: int) -> Iterator[SimulationScene]:
    """The simulation's scene with the encounter's posture as home, and its arm as the one that avoids; as bright as
    drawn, by turns in diffuse light and with the highlights of lamps."""
    setup = scene.setup_of(encounter)
    rng = np.random.default_rng((seed, 2))
    exposure = float(np.exp(rng.uniform(*np.log(_EXPOSURE))))
    fidelity = Fidelity(lighting="lights" if seed % 2 else "baked")
    sensor = Sensor(noise_sigma=noise_sigma, exposure=exposure)
    with Eyes(setup.robot, setup.rig, make_stimulus(encounter.stimulus), sensor=sensor, fidelity=fidelity) as eyes:
        yield SimulationScene(setup, eyes, np.random.default_rng(seed), encounter.side)

"""How the skin goes to school: an experimenter presses objects on it, one approach after another."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from tqdm import tqdm

from learning.pps.memory import PPSMemory
from learning.reach.map import ReachableMap
from pps_vision.app.encounter import World, make_encounter
from pps_vision.app.pipeline import Pipeline, PipelineParams
from pps_vision.app.school_params import SchoolParams
from pps_vision.app.stopwatch import Stopwatch
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.robot.silhouette import Silhouette
from pps_vision.robot.skin import INNER_FOREARM, icub_skin
from rendering.eyes import Eyes
from rendering.sensor import Sensor
from rendering.stimuli import make_stimulus
from tracking.tracker import Tracker, TrackerParams

SPEED_M_S = (0.05, 0.15)
_CONTACT_FRAMES = 14  # by then the object lies on the skin; its withdrawal teaches nothing


@contextmanager
def open_world(noise_sigma: float, seed: int) -> Iterator[World]:
    """The iCub at home with the skin of its left forearm and palm, its eyes open."""
    robot = load_icub()
    rig = icub_rig(robot)
    skin = icub_skin(("left_forearm", "left_palm"))
    with Eyes(robot, rig, make_stimulus("ball"), sensor=Sensor(noise_sigma=noise_sigma)) as eyes:
        yield World(robot, rig, skin, eyes, np.random.default_rng(seed))


def fresh_pipeline(
    world: World, memory: PPSMemory, stopwatch: Stopwatch | None = None, reachable_map: ReachableMap | None = None
) -> Pipeline:
    """A pipeline that has seen nothing yet but remembers `memory`."""
    timing = {} if stopwatch is None else {"stages": stopwatch}
    tracker = Tracker(TrackerParams(), world.rig, world.rng, own_body=Silhouette(world.robot), **timing)
    return Pipeline(PipelineParams(), world.robot, world.skin, tracker, memory, world.rng, reachable_map)


def teach(world: World, params: SchoolParams) -> PPSMemory:
    """What the skin remembers in the end; the inner taxels are aimed at in turn, objects alternate."""
    if params.trials < 1 or not params.objects:
        raise ValueError(f"{params.trials} trials with {len(params.objects)} objects; expected at least one of each")
    memory = PPSMemory.empty(world.skin)
    for trial in tqdm(range(params.trials), desc="learning", unit="approach", disable=None):
        taxel = f"left_forearm:{INNER_FOREARM[trial % len(INNER_FOREARM)]}"
        stimulus = params.objects[trial % len(params.objects)]
        speed = world.rng.uniform(*SPEED_M_S)
        encounter = make_encounter("approach", world, taxel, stimulus, world.rng, speed, reach_m=0.0)
        pipeline = fresh_pipeline(world, memory)
        contact_frames = 0
        meeting = world.meet(encounter, pipeline, avoid=False)
        for _, step in meeting:
            contact_frames += bool(step.events.touched.any())
            if contact_frames == _CONTACT_FRAMES:
                break
        memory = pipeline.finish()
    return memory

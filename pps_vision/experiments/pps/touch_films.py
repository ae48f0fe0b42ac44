"""Trials as the robot's eyes see them: rendered, tracked, head and eyes following; each kept in a file."""

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from hashlib import sha256
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from tqdm import tqdm

import rendering
import tracking
from control import fixation, head, rates
from learning.archive import read_archive, write_archive
from learning.pps.memory import PPSMemory
from learning.pps.touch_trial import TouchTrial
from pps_vision import geometry, robot
from pps_vision.app.pipeline import Pipeline, PipelineParams
from pps_vision.experiments.pps.touch_movements import STEP_S, Movement, of_gaze
from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.robot.model import Robot
from pps_vision.robot.silhouette import Silhouette
from pps_vision.robot.skin import Skin, icub_skin
from pps_vision.types import Array, Track3D
from rendering.eyes import Eyes
from rendering.names import CarrierName
from rendering.scene import SceneState
from rendering.sensor import Sensor
from rendering.stimuli import make_stimulus
from tracking.tracker import Tracker, TrackerParams

NOISE_SIGMA = 2.0  # of the eyes' pixels, grey levels of 255
_PROCESSES = 2
_KIND, _VERSION = "touch trial", 1
_SEEN = ("joints_rad", "positions", "velocities", "velocity_covs", "radius_m")


def watched(made: Sequence[Movement], folder: Path) -> tuple[TouchTrial, ...]:
    """What the robot knew of movements it watched.

    `folder` keeps every trial under a name that tells movement and code apart, so what was rendered before,
    by the same code, is read; an interrupted run goes on where it stopped.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"{movement.stimulus}_{_digest(movement)}.npz" for movement in made]
    todo = [(movement, file) for movement, file in zip(made, files, strict=True) if not file.exists()]
    if todo:
        with ProcessPoolExecutor(min(_PROCESSES, len(todo)), get_context("spawn")) as pool:
            done = pool.map(_film_to, *zip(*todo, strict=True))
            for _ in tqdm(done, "watching", len(todo), unit="trial", disable=None):
                pass
    return tuple(_read(movement, file) for movement, file in zip(made, files, strict=True))


def film(movement: Movement) -> TouchTrial:
    """What the robot knows of a movement that it watches with fresh eyes."""
    is_marker = movement.stimulus == "marker"
    icub, rig, skin, eyes = _lookout("none" if is_marker else "hand")
    eyes.set_stimulus(make_stimulus(movement.stimulus))
    rng = np.random.default_rng(int(_digest(movement), 16))
    tracker = Tracker(TrackerParams("marker" if is_marker else "generic"), rig, rng, own_body=Silhouette(icub))
    pipeline = Pipeline(PipelineParams(), icub, skin, tracker, PPSMemory.empty(skin), rng)
    tracks, joints = [], []
    q = movement.joints_rad[0]
    for t, arms, p in zip(movement.stamps_s, movement.joints_rad, movement.positions, strict=True):
        q = np.where(of_gaze(icub), q, arms)
        step = pipeline.step(eyes.render(SceneState(q, p, rotation=movement.rotation), t, rng))
        tracks.append(step.tracking.track)
        joints.append(q)
        q = icub.clamp(q + STEP_S * step.command.dq_rad_s)
    return _trial(movement, np.array(joints), tracks)


@cache
def _lookout(carrier: CarrierName) -> tuple[Robot, StereoRig, Skin, Eyes]:
    """This process's robot, its calibrated eyes, its skin, and what it sees with them."""
    icub = load_icub()
    rig = icub_rig(icub)
    eyes = Eyes(icub, rig, make_stimulus("ball"), carrier, Sensor(noise_sigma=NOISE_SIGMA))
    return icub, rig, icub_skin(), eyes


def _trial(movement: Movement, joints_rad: Array, tracks: Sequence[Track3D]) -> TouchTrial:
    return TouchTrial(
        movement.stamps_s,
        joints_rad,
        np.array([track.position for track in tracks]),
        np.array([track.velocity for track in tracks]),
        np.array([track.cov[3:6, 3:6] for track in tracks]),
        np.array([track.radius_m for track in tracks]),
        movement.touched,
        movement.aimed,
    )


def _film_to(movement: Movement, file: Path) -> None:
    trial = film(movement)
    write_archive(file, _KIND, _VERSION, {name: getattr(trial, name) for name in _SEEN})


def _read(movement: Movement, file: Path) -> TouchTrial:
    seen = {name: array.astype(float) for name, array in read_archive(file, _KIND, _VERSION, _SEEN).items()}
    return TouchTrial(stamps_s=movement.stamps_s, touched=movement.touched, aimed=movement.aimed, **seen)


def _digest(movement: Movement) -> str:
    """A name for a movement as this code shows and sees it."""
    digest = sha256(_code())
    digest.update(f"{movement.stimulus} {NOISE_SIGMA}".encode())
    for array in (movement.rotation, movement.stamps_s, movement.joints_rad, movement.positions):
        digest.update(array.tobytes())
    return digest.hexdigest()[:24]


@cache
def _code() -> bytes:
    """All that decides how a movement is drawn, tracked and followed."""
    rooms = [Path(str(package.__file__)).parent for package in (rendering, tracking, geometry)]
    files = [file for room in rooms for file in room.rglob("*") if file.suffix == ".py"]
    files += [Path(str(module.__file__)) for module in (fixation, head, rates)]
    files += [*Path(str(robot.__file__)).parent.glob("*.urdf"), Path(__file__)]
    return b"".join(file.read_bytes() for file in sorted(files))

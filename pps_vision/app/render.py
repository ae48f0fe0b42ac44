"""`pps-vision render`: a recording of a robot that watches a moving object, with its truth."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, get_args

import numpy as np

from control import fixation
from control.limits import MAX_HOLD_S
from pps_vision.app.progress import progress
from pps_vision.app.render_params import RenderParams
from pps_vision.app.simulation import REACH_M, at_taxel, can_follow
from pps_vision.app.versions import versions
from pps_vision.errors import InputError, expect_kinds
from pps_vision.recordings.open import open_recording
from pps_vision.recordings.recording import Recording
from pps_vision.recordings.robot_file import robot_setup
from pps_vision.recordings.yarp_writer import YarpWriter
from pps_vision.robot.model import Robot
from pps_vision.robot.robot_setup import RobotSetup
from pps_vision.robot.skin import Skin, touched_taxels
from pps_vision.types import Array
from rendering.eyes import Eyes
from rendering.fidelity import Fidelity
from rendering.motions import Motion, make_motion
from rendering.names import MESH_SUFFIXES, MotionName, StimulusName
from rendering.scene import SceneState
from rendering.sensor import Sensor
from rendering.stimuli import Stimulus, make_stimulus
from rendering.stimulus_file import load_stimulus

_SWAY = np.deg2rad([4.0, 2.5])  # neck yaw, pitch: amplitude of the head's own motion
_SWAY_HZ = np.array([0.31, 0.23])
_LARGEST_M = 0.3  # radius of an object that fits into the view


def record(options: RenderParams) -> tuple[int, int]:
    """Write the recording; return the number of pairs, and of pairs with a touch; errors as `render`."""
    if not (0 < options.seconds < math.inf and 0 < options.fps < math.inf):
        raise InputError("render", f"--seconds {options.seconds}, --fps {options.fps}; expected positive numbers")
    if options.radius is not None and not 0 < options.radius <= _LARGEST_M:
        raise InputError("render", f"--radius {options.radius} m; expected above 0 and at most {_LARGEST_M}")
    if options.center is not None and not np.all(np.isfinite(options.center)):
        raise InputError("render", f"--center {options.center}; expected three numbers in metres")
    rng = np.random.default_rng(options.seed)
    setup = robot_setup(options.robot)
    fidelity = Fidelity(scale=options.scale)
    stimulus = stimulus_of(options, fidelity.fineness)
    sensor = Sensor(options.noise, options.shot, options.exposure, options.blur_s)
    states = list(scene(options, setup, rng))
    with Eyes(setup.robot, setup.rig, stimulus, options.carrier, sensor, fidelity=fidelity) as eyes:
        touches = write_recording(options.out, setup, eyes, states, rng, setup.skin, {**asdict(options), "out": None})
    return len(states), touches


def write_recording(
    out: Path,
    setup: RobotSetup,
    eyes: Eyes,
    states: Sequence[tuple[float, SceneState]],
    rng: np.random.Generator,
    skin: Skin | None,
    options: Mapping[str, object],
) -> int:
    """Render the states at their stamps into a recording; return the number of pairs with a touch.

    `rng`: of the sensor's noise; `skin`: what feels the object, if anything; `options`: how it was made, for
    summary.json.  InputError unless `out` is new or empty.
    """
    touches = 0
    with YarpWriter(out, setup) as writer:
        for t, state in progress(states, desc="render", unit="pair"):
            truth = eyes.truth(state, t)
            writer.write_frame(eyes.render(state, t, rng))
            writer.write_joints(t, state.q_rad)
            if skin is not None:
                touched = touched_taxels(skin.at(setup.robot.at(state.q_rad))[0], truth.position, truth.radius_m)
                touches += bool(touched.any())
                writer.write_touches(t, np.array(skin.taxel_ids)[touched])
            writer.write_truth(truth)
        writer.write_summary({"render": options, "versions": versions()})
    return touches


def stimulus_of(options: RenderParams, fineness: int) -> Stimulus:
    """The object to render; InputError and OSError name a mesh file that cannot be used."""
    if isinstance(options.stimulus, Path):
        if options.stimulus.suffix.lower() not in MESH_SUFFIXES:
            names = ", ".join((*get_args(StimulusName), *(f"FILE{suffix}" for suffix in MESH_SUFFIXES)))
            raise InputError("render", f"--stimulus {options.stimulus}; expected one of {names}")
        return load_stimulus(options.stimulus, options.unit, options.radius)
    return make_stimulus(options.stimulus, options.radius, fineness)


def scene(options: RenderParams, setup: RobotSetup, rng: np.random.Generator) -> Iterator[tuple[float, SceneState]]:
    """Stamp and state of each frame."""
    robot = setup.robot
    q, motion = _begin(options, setup, rng, stimulus_of(options, 0).radius_m)
    dt = 1 / options.fps
    for k in range(max(1, round(options.seconds * options.fps))):
        t = k * dt
        p, v = motion(t)
        dq = _head_rate(options, robot, q, p, v, t, dt)
        yield t, SceneState(q, p, v, dq)
        q = robot.clamp(q + dt * dq)


def _begin(options: RenderParams, setup: RobotSetup, rng: np.random.Generator, radius_m: float) -> tuple[Array, Motion]:
    """The robot at home fixating the start of a random motion that both eyes can follow."""
    robot = setup.robot
    q_home = setup.home_rad
    skin = setup.skin
    if options.robot and options.center is None and options.motion not in REACH_M:
        raise InputError("render", f"--motion {options.motion} without --center; expected one, before the cameras")
    at_home = robot.at(q_home)
    aim = None
    taxels, _ = skin.at(at_home)
    if options.motion in REACH_M or options.target != RenderParams.target:
        aim = at_taxel(skin, at_home, skin.index(options.target), radius_m + REACH_M.get(options.motion, 0.0))
    for _ in range(200):
        speed = rng.uniform(0.05, 0.15) if options.speed is None else options.speed
        center = _before_the_eyes(rng) if options.center is None else np.array(options.center)
        motion = make_motion(options.motion, rng, center, speed, aim)
        begin = motion(0.0)[0]
        begins_touching = touched_taxels(taxels, begin, radius_m).any()
        if not begins_touching and can_follow(robot, setup.rig, q_home, motion, options.seconds):
            return fixation.gaze_at(robot, q_home, begin), motion
    place = options.target if options.motion in REACH_M else options.center
    problem = f"no {options.motion}{f' about {place}' if place else ''} stays in view of both eyes"
    raise InputError("render", f"{problem}; expected another target or center, or a slower motion")


def _head_rate(options: RenderParams, robot: Robot, q: Array, p: Array, v: Array, t: float, dt: float) -> Array:
    """Joint rates until the next frame: fixation of where the object will be, and the sway."""
    dq: Array = np.zeros(robot.n_joints)
    if options.head == "still" or not robot.names.gaze_joints:
        return dq
    if options.head == "follow":
        gains = fixation.FixationParams(gain_per_s=min(8.0, 0.6 / dt))
        dq = fixation.step(gains, robot.at(q), p, v, min(dt, MAX_HOLD_S)).dq_rad_s.copy()
    phase = 2 * np.pi * _SWAY_HZ
    yaw, pitch = robot.indices(robot.names.gaze_joints)[:2]
    dq[[yaw, pitch]] += _SWAY * phase * np.cos(phase * t)
    return dq


def _before_the_eyes(rng: np.random.Generator) -> Array:
    """A point 0.33–0.52 m before the eyes of the iCub at home, so that a motion about it keeps to 0.25–0.6 m."""
    azimuth, elevation = np.deg2rad([rng.uniform(-15, 15), rng.uniform(-25, 5)])
    distance = rng.uniform(0.33, 0.52)
    ahead = np.array([-np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    return np.array([-0.063, 0.0, 0.341]) + distance * ahead


def render(stimulus: StimulusName | Path, motion: MotionName, out: Path | str, **options: Any) -> Recording:
    """Render a recording of a robot that watches a moving object, and open it.

    Args:
        stimulus: The object: a name, or a mesh file (.stl, .obj, .ply).
        motion: How it moves.
        out: Folder to write; must be new or empty.
        options: As in `pps-vision render --help`: seconds, fps, speed, radius, noise, carrier, head, seed, ….

    Returns:
        The recording, with its calibration, joints, touches and true path.

    Raises:
        InputError: An option is out of its range, nothing can be seen so, or the folder cannot be written.
    """
    expect_kinds("render", locals() | options, RenderParams.__annotations__ | render.__annotations__)
    params = RenderParams(stimulus, motion, Path(out), **options)
    record(params)
    return open_recording(params.out, robot=robot_setup(params.robot))

"""Each part of the system switched off, and what changes, on the same recordings, objects and robots.

The mean over recordings, objects or robots, with the part and without it, and the change, with 95 % over these units. A
part whose every change holds 0 in its interval decides nothing of what was measured here.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from tqdm import tqdm

from learning.reach.labels import ReachOracle
from learning.reach.training import train_reachable_map
from pps_vision.app.encounters.encounter import HARMLESS
from pps_vision.app.encounters.kinematic import simulate_encounter
from pps_vision.app.encounters.registry import ONE_GATED, OURS, memory_of, new_controller
from pps_vision.app.encounters.robots import MiscalibratedRobot
from pps_vision.app.encounters.training import Memories, learn_from
from pps_vision.experiments import reach_in_loop
from pps_vision.experiments.encounters.learning import (
    PER_ROBOT,
    RobotTask,
    encounter_of,
    mind,
    scene,
    side_of,
    training,
)
from pps_vision.experiments.films.cases import NEW_CASES
from pps_vision.experiments.films.recordings import EYES_M, FPS, MOTIONS, Footage, from_film, moving
from pps_vision.experiments.films.scenes import Film
from pps_vision.experiments.films.score import NEAR, measure_film
from pps_vision.experiments.films.score import OURS as TRACKER
from pps_vision.experiments.reach_truth import map_params
from pps_vision.experiments.stages import trigger
from pps_vision.experiments.study import DATA, Part, PartsStudy, SampledStudy, interval, mean, rms
from pps_vision.experiments.tables import Table, estimate
from pps_vision.robot.icub import load_icub
from pps_vision.types import Array
from tracking.kalman import KalmanParams
from tracking.motion_trigger import TriggerParams
from tracking.particle_filter import ParticleFilterParams
from tracking.tracker import Tracker, TrackerParams

Units = Sequence[Mapping[str, float]]  # of each unit the quantities; NaN where there is none
_WITH = "with"
_ERROR_M = 0.03  # of the robots' position of what touches them, RMS
_FAST_M_S = 0.4
_SETTLE_S = 0.5
_VARIANTS = {
    _WITH: TrackerParams(),
    "optical flow of the trigger": TrackerParams(trigger=TriggerParams(flow=False)),
    "particles (2 for 120)": TrackerParams(particles=ParticleFilterParams(count=2)),
    "particles (1000 for 120)": TrackerParams(particles=ParticleFilterParams(count=1000)),
    "order 4 (3)": TrackerParams(kalman=KalmanParams.of_order(3)),
    "order 4 (2)": TrackerParams(kalman=KalmanParams.of_order(2)),
}


def _changes(units: Mapping[str, Units]) -> list[dict[str, Any]]:
    """Return for each part, and quantity, the means with it and without it and of the change."""
    rows = []
    for part in (name for name in units if name != _WITH):
        for quantity in units[part][0]:
            pairs = np.array([[a[quantity], b[quantity]] for a, b in zip(units[_WITH], units[part], strict=True)])
            pairs = pairs[np.isfinite(pairs).all(axis=1)]
            values = (pairs[:, 0], pairs[:, 1], pairs[:, 1] - pairs[:, 0])
            cells = [interval(column[:, None]) for column in values]
            rows.append({"part": part, "quantity": quantity, "n": len(pairs), "with, without, change": cells})
    return rows


def _tracking(study: "Decides") -> dict[str, Any]:
    """A rendered ball, slow and fast, followed by the eyes while the head sways."""
    units: dict[str, list[dict[str, float]]] = {name: [] for name in (*_VARIANTS, "stereo (size in the left eye)")}
    for seed in tqdm(study.seeds, "tracking", disable=None):
        speed = {"speed": _FAST_M_S} if seed % 2 else {}
        recording = moving("ball", MOTIONS[seed // 2 % len(MOTIONS)], seed, study.seconds, **speed)
        for name, params in _VARIANTS.items():
            own, of_one_eye = _tracked(recording, params, seed)
            units[name].append(own)
            if name == _WITH:
                units["stereo (size in the left eye)"].append(of_one_eye)
    return {"rows": _changes(units)}


def _tracked(recording: Footage, params: TrackerParams, seed: int) -> tuple[dict[str, float], dict[str, float]]:
    """Scores of the tracker, and of the places by direction and size in the left eye, given the true radius."""
    tracker = Tracker(params, recording.rig, np.random.default_rng(seed), own_body=recording.own_body)
    steps = [tracker.step(frame) for frame in recording.frames]
    tracks = [step.track for step in steps]
    known = np.array([track.is_known for track in tracks])
    path, velocity = (np.array([getattr(track, name) for track in tracks]) for name in ("position", "velocity"))
    by_size = np.full_like(path, np.nan)
    for k, (frame, step) in enumerate(zip(recording.frames, steps, strict=True)):
        for seen in (detection for detection in step.detections if detection.camera == "left"):
            eye = recording.rig.view_of(frame).left
            distance_m = recording.radius_m / np.sin(seen.angular_radius_rad)
            by_size[k] = eye.center + distance_m * eye.rays(seen.center_px[None])[0]
    judged = recording.judged(_SETTLE_S)
    own = _scores(recording, np.where(known[:, None], path, np.nan), judged)
    own["velocity, RMS (mm/s)"] = 1000 * rms(np.linalg.norm(velocity - recording.velocity, axis=1)[judged & known])
    return own, _scores(recording, by_size, judged)


def _scores(recording: Footage, path: Array, judged: Array) -> dict[str, float]:
    """Share of the `judged` frames near the object, and RMS error of the known places."""
    error = np.linalg.norm(path - recording.position, axis=1)
    near = error <= NEAR * np.linalg.norm(recording.position - EYES_M, axis=1)
    known = judged & np.isfinite(error)
    return {"near the object (%)": 100 * mean(near[judged]), "position, RMS (mm)": 1000 * rms(error[known])}


def _fixation(study: "Decides") -> dict[str, Any]:
    """The same motions of a ball with eyes that fixate it, and with a head that rests; of all frames."""
    units: dict[str, list[dict[str, float]]] = {_WITH: [], "fixation (head and eyes rest)": []}
    for seed in tqdm(study.seeds, "fixation", disable=None):
        for name, head in zip(units, ("follow", "still"), strict=True):
            motion = MOTIONS[seed % len(MOTIONS)]
            recording = moving("ball", motion, seed, study.seconds, speed=_FAST_M_S, head=head)
            everywhere = replace(recording, visible=np.ones(len(recording.frames), bool))
            units[name].append(_tracked(everywhere, TrackerParams(), seed)[0])
    return {"rows": _changes(units)}


def _flow(study: "Decides") -> dict[str, Any]:
    """The motion trigger where nothing moves but the head, before photographs."""
    units: dict[str, list[dict[str, float]]] = {_WITH: [], "optical flow of the trigger": []}
    for seed in tqdm(study.seeds, "trigger", disable=None):
        calm = trigger.film_scene(np.random.default_rng((seed, 45)), 2 * study.seconds, *trigger.OBJECTS["nothing"])
        recording = from_film(Film(calm, seed, study.data))
        for name, method in zip(units, trigger.OURS.values(), strict=True):
            alarms = method(recording, seed)["alarm"]
            units[name].append({"false alarms a minute": 60 * FPS * mean(np.asarray(alarms))})
    return {"rows": _changes(units)}


def _objects(study: "Decides") -> dict[str, Any]:
    """Ray-cast films of two objects; of two of one colour the worse one counts."""
    units: dict[str, list[dict[str, float]]] = {_WITH: [], "several objects (1)": []}
    for k in tqdm(range(max(study.n // 2, 1)), "objects", disable=None):
        scores: dict[str, dict[str, float]] = {name: {} for name in units}
        for case in NEW_CASES:
            if case.name not in ("two of one colour cross", "nearer comes later"):
                continue
            film = Film(case.scene(k), study.seed + k, study.data)
            for name, count in zip(units, (4, 1), strict=True):
                measured = measure_film(film, replace(case.tracker(film.hue_deg), max_objects=count), each=case.each)
                scores[name][f"{case.name}: right (%)"] = measured[TRACKER]["right_percent"]
        for name in units:
            units[name].append(scores[name])
    return {"rows": _changes(units)}


def _touch(study: "Decides") -> dict[str, Any]:
    """Robots that misjudge by 3 cm where objects touch them, which learn from a share of R's approaches."""
    units: dict[str, list[dict[str, float]]] = {
        name: []
        for name in (_WITH, "learned activation (constant 1, gates by hand)", "learned body (encoders as they are)")
    }
    for k in tqdm(range(max(study.n // 2, 1)), "touch", disable=None):
        task = RobotTask(k, _ERROR_M, study.seed, study.share, (OURS, ONE_GATED))
        robot, calibrated, memories = mind(task)
        trials = training(side_of(k), study.seed, study.share)
        uncorrected = learn_from(scene(), side_of(k), trials, robot, np.random.default_rng((study.seed, k, 1)), False)
        bodies = (calibrated, memories, OURS), (calibrated, memories, ONE_GATED), (robot, uncorrected, OURS)
        for name, body in zip(units, bodies, strict=True):
            units[name].append(_met(task, robot, *body))
    return {"rows": _changes(units)}


def _met(
    task: RobotTask, robot: MiscalibratedRobot, body: MiscalibratedRobot, memories: Memories, name: str
) -> dict[str, float]:
    """Shares of a robot's encounters untouched and left alone, as it takes its `body` to be."""
    rng = np.random.default_rng((task.seed, task.robot, 2))
    right: dict[bool, list[bool]] = {False: [], True: []}
    for condition, n in PER_ROBOT.items():
        for k in range(n):
            encounter, tracks = encounter_of(task, condition, k, n)
            reading = body.joint_offsets_rad + robot.reading(rng) - robot.joint_offsets_rad
            seen = body.see(tracks, encounter.q_rad, reading)
            arguments = memory_of(name, memories), encounter, name, new_controller(name), seen
            result = simulate_encounter(scene(), *arguments, erring=(body.scene, reading))
            right[condition in HARMLESS].append(not (result.commands if condition in HARMLESS else result.touched))
    return {"hazards untouched (%)": 100 * mean(right[False]), "harmless at rest (%)": 100 * mean(right[True])}


def _map(study: "Decides") -> dict[str, Any]:
    """Objects beyond the reach of the upright iCub, to which it leans by the map, or by none: all is within reach."""
    robot = load_icub()
    rng = np.random.default_rng(study.seed)
    params = replace(map_params(study.n_labels), gaze_limits=reach_in_loop.GAZE, arm_limits=reach_in_loop.ARM)
    learned = train_reachable_map(robot, reach_in_loop.SIDE, rng, params)
    lean_once = partial(reach_in_loop.attempt, ReachOracle(robot, reach_in_loop.SIDE, params, rng), learned)
    units: dict[str, list[dict[str, float]]] = {_WITH: [], "reachable map (all is within reach)": []}
    points = reach_in_loop.draw_unreachable(robot, 5 * study.n, np.random.default_rng(study.seed + 1_000_000))
    for point in tqdm(points, "map", disable=None):
        for name, threshold in zip(units, (learned.threshold(reach_in_loop.MAX_FP), -1.0), strict=True):
            units[name].append({"touched (%)": 100.0 * lean_once(threshold, point, True).is_touched})
    return {"rows": _changes(units)}


@dataclass(frozen=True)
class Decides(PartsStudy, SampledStudy):
    """What each part of the design decides: its table is one of all parts."""

    PARTS: ClassVar[Mapping[str, Part]] = {
        "tracking": Part(_tracking),
        "touch": Part(_touch),
        "map": Part(_map),
        "fixation": Part(_fixation),
        "objects": Part(_objects),
        "flow": Part(_flow),
    }
    SHORT: ClassVar[Mapping[str, Any]] = {"n_labels": 600, "share": 0.02}

    n: int = 6  # recordings; half as many films of several objects and robots, five times as many objects to reach
    seconds: float = 2.5  # length of a recording; twice as long where nothing moves
    share: float = 0.2  # of R's numbers of training approaches
    n_labels: int = 3000  # inverse-kinematics solutions of the map
    data: Path = DATA  # folder of the photographs (default: PPS_VISION_DATA, else ../shared/data)

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return a row for each part and quantity; no change whose interval holds 0."""
        rows = []
        for row in (row for part in self.PARTS if part in numbers for row in numbers[part]["rows"]):
            own, without, (change, low, high) = row["with, without, change"]
            decides = "yes" if low > 0 or high < 0 else "no"
            cells = estimate(own), estimate(without), estimate([change, low, high]), decides
            rows.append([row["part"], row["quantity"], str(row["n"]), *cells])
        header = ["part, in its place", "quantity", "n", "with it", "without", "change", "decides"]
        return {"": Table(header, rows)}

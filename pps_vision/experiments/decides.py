"""Each part of the design switched off, and what changes, on the same recordings, objects and robots.

The means with the part, without it, and of the change, with 95 % over recordings, objects or robots. A part whose every
change holds 0 in its interval decides nothing here.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from tqdm import tqdm

from pps_vision.app.encounters.registry import ONE_GATED, OURS
from pps_vision.app.encounters.suite import scene
from pps_vision.app.encounters.training import learn_from
from pps_vision.experiments import reach_in_loop
from pps_vision.experiments.encounters.learning import (
    RobotTask,
    mind,
    rows_of_minds,
    scores_of,
    side_of,
    training,
)
from pps_vision.experiments.films import score
from pps_vision.experiments.films.cases import CASES, NEW_CASES
from pps_vision.experiments.films.recordings import EYES_M, FPS, MOTIONS, Footage, from_film, moving
from pps_vision.experiments.films.scenes import Film
from pps_vision.experiments.stages import trigger
from pps_vision.experiments.study import DATA, Part, PartsStudy, SampledStudy, interval, mean, rms
from pps_vision.experiments.tables import Table, estimate
from pps_vision.types import Array, Mask
from tracking.kalman import KalmanParams
from tracking.motion_trigger import TriggerParams
from tracking.particle_filter import ParticleFilterParams
from tracking.tracker import Tracker, TrackerParams

Unit = Mapping[str, Mapping[str, float]]
"""Quantities of a recording, object or robot: first with all parts, then without each."""
_ERROR_M = 0.03  # RMS error of the robots' position of touching objects
_FAST_M_S = 0.4
_SETTLE_S = 0.5
_TRACKERS = {
    "": TrackerParams(),
    "optical flow of the trigger": TrackerParams(trigger=TriggerParams(flow=False)),
    "particles (2 for 120)": TrackerParams(particles=ParticleFilterParams(count=2)),
    "particles (1000 for 120)": TrackerParams(particles=ParticleFilterParams(count=1000)),
    "order 4 (3)": TrackerParams(kalman=KalmanParams.of_order(3)),
    "order 4 (2)": TrackerParams(kalman=KalmanParams.of_order(2)),
}


def _run(unit: Callable[["Decides", int], Unit], share: float, study: "Decides") -> dict[str, Any]:
    """Return the mean of each quantity with a part, without it, and of the change, over a share of n units."""
    numbers = range(max(round(share * study.n), 1))
    units = [unit(study, k) for k in tqdm(numbers, disable=None)]
    rows = []
    for part, quantities in list(units[0].items())[1:]:
        for quantity in quantities:
            pairs = np.array([[next(iter(unit.values()))[quantity], unit[part][quantity]] for unit in units])
            pairs = pairs[np.isfinite(pairs).all(axis=1)]
            cells = [interval(x[:, None]) for x in (pairs[:, 0], pairs[:, 1], pairs[:, 1] - pairs[:, 0])]
            rows.append({"part": part, "quantity": quantity, "n": len(pairs), "with, without, change": cells})
    return {"rows": rows}


def _tracking(study: "Decides", k: int) -> Unit:
    """A rendered ball, slow and fast, that the eyes follow while the head sways."""
    seed = study.seed + k
    speed = _FAST_M_S if k % 2 else None
    recording = moving("ball", MOTIONS[k // 2 % len(MOTIONS)], seed, study.seconds, speed=speed)
    both = {name: _tracked(recording, params, seed) for name, params in _TRACKERS.items()}
    return {name: own for name, (own, _) in both.items()} | {"stereo (size in the left eye)": both[""][1]}


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


def _scores(recording: Footage, path: Array, judged: Mask) -> dict[str, float]:
    """Share of the `judged` frames near the object, and RMS error of the known places."""
    error = np.linalg.norm(path - recording.position, axis=1)
    near = error <= score.NEAR * np.linalg.norm(recording.position - EYES_M, axis=1)
    known = judged & np.isfinite(error)
    return {"near the object (%)": 100 * mean(near[judged]), "position, RMS (mm)": 1000 * rms(error[known])}


def _fixation(study: "Decides", k: int) -> Unit:
    """A fast ball before eyes that fixate it, and before a head that rests; all frames count."""
    unit = {}
    for name, head in {"": "follow", "fixation (head and eyes rest)": "still"}.items():
        motion = MOTIONS[k % len(MOTIONS)]
        recording = moving("ball", motion, study.seed + k, study.seconds, speed=_FAST_M_S, head=head)
        everywhere = replace(recording, visible=np.ones(len(recording.frames), bool))
        unit[name] = _tracked(everywhere, TrackerParams(), study.seed + k)[0]
    return unit


def _flow(study: "Decides", k: int) -> Unit:
    """The motion trigger where nothing moves but the head, before photographs."""
    seed = study.seed + k
    calm = trigger.film_scene(np.random.default_rng((seed, 45)), 2 * study.seconds, *trigger.OBJECTS["nothing"])
    recording = from_film(Film(calm, seed, study.data))
    alarms = [np.asarray(method(recording, seed)["alarm"]) for method in trigger.OURS.values()]
    names = "", "optical flow of the trigger"
    return {name: {"false alarms a minute": 60 * FPS * mean(own)} for name, own in zip(names, alarms, strict=True)}


def _films(study: "Decides", k: int, part: str, cases: Sequence[str], **options: Any) -> Unit:
    """Ray-cast films of cases, tracked without and with options of `TrackerParams`; of two of one colour the worse ball
    counts."""
    unit: dict[str, dict[str, float]] = {"": {}, part: {}}
    for case in (case for case in (*CASES, *NEW_CASES) if case.name in cases):
        film = Film(case.scene(k), study.seed + k, study.data)
        params = case.tracker(film.hue_deg)
        scores = score.measure_film(film, params, each=case.each, variants={part: replace(params, **options)})
        for name, own in zip(unit, scores.values(), strict=True):
            unit[name][f"{case.name}: right (%)"] = own["right_percent"]
    return unit


def _touch(study: "Decides", k: int) -> Unit:
    """A robot that misjudges by 3 cm where objects touch it, and has learned from a share of R's approaches."""
    task = RobotTask(k, _ERROR_M, study.seed, study.share, (OURS, ONE_GATED))
    robot, calibrated, memories = mind(task)
    trials = training(side_of(k), study.seed, study.share)
    uncorrected = learn_from(scene(), side_of(k), trials, robot, np.random.default_rng((study.seed, k, 1)), False)
    minds = {
        "": (OURS, calibrated, memories),
        "learned activation (constant 1, gates by hand)": (ONE_GATED, calibrated, memories),
        "learned body (encoders as they are)": (OURS, robot, uncorrected),
    }
    rows = rows_of_minds(task, robot, minds)
    quantities = "hazards untouched (%)", "harmless at rest (%)"
    return {name: dict(zip(quantities, scores_of(rows, _ERROR_M, name)[k], strict=False)) for name in minds}


def _map(study: "Decides", k: int) -> Unit:
    """An object to which the torso leans by the map, or by one that calls everything reachable."""
    points, lean_once, learned = reach_in_loop.leaning(study.seed, 5 * study.n, study.n_labels)
    names = {"": learned.threshold(reach_in_loop.MAX_FP), "reachable map (all is within reach)": -1.0}
    return {
        name: {"touched (%)": 100.0 * lean_once(least, points[k], True).is_touched} for name, least in names.items()
    }


_objects = partial(
    _films, part="several objects (1)", cases=("two of one colour cross", "nearer comes later"), max_objects=1
)
_particles = partial(
    _films,
    part="particles (2 for 120)",
    cases=("1 m/s, instant reversal", "hand holds", "hand takes"),
    particles=ParticleFilterParams(count=2),
)


@dataclass(frozen=True)
class Decides(PartsStudy, SampledStudy):
    """What each part of the design decides; one table of all parts of the study."""

    MINUTES: ClassVar[int] = 12
    PARTS: ClassVar[Mapping[str, Part]] = {
        "tracking": Part(partial(_run, _tracking, 1.0)),
        "touch": Part(partial(_run, _touch, 0.5)),
        "map": Part(partial(_run, _map, 5.0)),
        "fixation": Part(partial(_run, _fixation, 1.0)),
        "objects": Part(partial(_run, _objects, 0.5)),
        "particles": Part(partial(_run, _particles, 0.5)),
        "flow": Part(partial(_run, _flow, 1.0)),
    }
    SHORT: ClassVar[Mapping[str, Any]] = {"n_labels": 600, "share": 0.02}

    n: int = 6  # recordings; half as many films of several objects and robots, five times as many objects to reach
    seconds: float = 2.5  # length of a recording; twice as long where nothing moves
    share: float = 0.2  # of R's numbers of training approaches
    n_labels: int = 3000  # inverse-kinematics solutions of the map
    data: Path = DATA  # folder of the photographs (default: PPS_VISION_DATA, else ../shared/data)

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return a row for each part and quantity that it changes; a change is bold if its interval excludes 0."""
        rows = []
        for row in (row for part in self.PARTS if part in numbers for row in numbers[part]["rows"]):
            own, _, change = row["with, without, change"]
            if any(change):
                text = estimate(change)
                is_certain = change[1] > 0 or change[2] < 0
                rows.append(
                    [row["part"], row["quantity"], str(row["n"]), estimate(own), f"**{text}**" if is_certain else text]
                )
        return {"": Table(["without (in its place)", "quantity", "n", "with it", "change"], rows)}

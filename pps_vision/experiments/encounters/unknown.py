"""Surfaces that geometry does not know: a stick in the hand, a thick sleeve, objects larger than they are taken to be.

A subject has one arm and one such surface.  Its robot and eyes are without error, but perceive the skin as it would be
without the surface, the objects as smaller than they are.  It learns from touches and as many passing objects, then
meets hazards to the surface.  Nothing tells it which surface it has.
"""

from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from learning.pps.joint_offsets import TouchTrial
from learning.pps.learner import LearnerState, finish, miss, observe
from learning.pps.memory import PPSMemory, activation
from learning.pps.tool import touch_beyond, with_tool
from pps_vision.app.encounters.encounter import (
    BEYOND_M,
    HARMLESS,
    PASS_M,
    PRESS_M,
    SPEED_M_S,
    Aim,
    Condition,
    DrawPath,
    EncounterScene,
    approach,
    draw_posture,
    draw_visible,
    passing,
)
from pps_vision.app.encounters.kinematic import simulate_encounter
from pps_vision.app.encounters.registry import CONTROLLERS, GEOMETRY, ONE_GATED, OURS
from pps_vision.app.encounters.suite import Rows
from pps_vision.app.encounters.tracks import track_of
from pps_vision.app.encounters.training import Trial, events_of
from pps_vision.app.simulation import REACH_M, Side
from pps_vision.app.simulation import SPEED_M_S as TRAINING_SPEED_M_S
from pps_vision.experiments.encounters.controllers import unfinished_folder
from pps_vision.experiments.encounters.unfinished import run_tasks
from pps_vision.experiments.study import interval
from pps_vision.experiments.tables import Table, estimate, judged
from pps_vision.robot.icub import icub_setup
from pps_vision.robot.skin import Skin, SkinPart, icub_skin
from pps_vision.types import Track3D
from rendering.names import StimulusName
from rendering.stimuli import make_stimulus

Case = Literal["stick", "sleeve", "radius"]
COMPARED = (OURS, ONE_GATED, GEOMETRY)
TOUCHES = 50
PER_CONDITION = 4
STICK_M = 0.15  # from the foremost taxel of the palm to the tip, along the fingers
SLEEVE_M = 0.03
RADIUS_ERROR_M = 0.02
_STICK_POINTS = 5
_AIMED_AT = ("stick:3", "stick:4")  # the stick's outermost 3 cm
_TOUCH = approach(REACH_M["approach"])
_PASS = passing((0.0, 0.20))
_PATHS: dict[Condition, DrawPath] = {
    "stop": approach(0.0),
    "press": approach(PRESS_M),
    "through": approach(BEYOND_M),
    "harmless_passing": passing(PASS_M),
}
_OBJECTS: tuple[StimulusName, ...] = ("ball", "cube", "octopus")
_DRAWS = 6  # paths tried for a posture
_LEAD_S = 0.5  # before the contact, at which the stick's receptive field is measured
_AFTER = (0, 10, 25, 50)  # touches after which it is measured
_GOAL = 80.0


class SubjectTask(NamedTuple):
    """Training and encounters of a subject."""

    subject: int
    case: Case
    seed: int
    n_touches: int


def run(study: Any) -> dict[str, Any]:
    """Return by case and controller the percentages of hazards untouched and of passing objects without a command, and
    the activation ahead of a touch of the stick by number of touches, with 95 % over subjects."""
    n_touches = max(round(study.share * TOUCHES), 2)
    tasks = {
        f"subject {k}, {case}": SubjectTask(k, case, study.seed, n_touches)
        for k in range(study.n_subjects)
        for case in get_args(Case)
    }
    rows = run_tasks(unfinished_folder(study, "unknown"), subject_rows, tasks, study.workers)
    met = [row for row in rows if "controller" in row]
    cells = {
        case: {
            name: {
                "untouched": _by_subject(met, case, name, "touched", is_harmless=False),
                "still": _by_subject(met, case, name, "commands", is_harmless=True),
            }
            for name in COMPARED
        }
        for case in get_args(Case)
    }
    ahead = [row["ahead"] for row in rows if "ahead" in row]
    growth = {after: interval([[of_subject[after]] for of_subject in ahead]) for after in ahead[0]}
    return {"subjects": study.n_subjects, "touches": n_touches, "cases": cells, "stick": growth}


def subject_rows(task: SubjectTask, folder: Path | None = None) -> Rows:
    """Return a row for each encounter and controller of a subject, and one for the receptive field of the stick."""
    side: Side = get_args(Side)[task.subject % 2]
    true = world(side, task.case)
    rng = np.random.default_rng((task.seed, get_args(Case).index(task.case), task.subject))
    memory = PPSMemory.empty(bare().skins[side])
    probes = [trial_of(task.case, side, "through", rng) for _ in range(PER_CONDITION)] if task.case == "stick" else []
    ahead = {"0": activation_ahead(memory, probes)}
    for k, until in pairwise(sorted({after for after in _AFTER if after < task.n_touches} | {0, task.n_touches})):
        paths: list[tuple[Condition, DrawPath]] = [("press", _TOUCH), ("harmless_passing", _PASS)] * (until - k)
        trials = [trial_of(task.case, side, condition, rng, path) for condition, path in paths]
        memory = learned(side, memory, true, trials)
        if until in _AFTER:
            ahead[str(until)] = activation_ahead(memory, probes)
    rows: Rows = []
    for condition in _PATHS:
        for _ in range(PER_CONDITION):
            trial = trial_of(task.case, side, condition, rng)
            for name in COMPARED:
                own = memory if name == OURS else PPSMemory.constant(bare().skins[side])
                arguments = trial.encounter, name, CONTROLLERS[name].new, trial.tracks
                erring = bare(), np.zeros(true.robot.n_joints)
                result = simulate_encounter(true, own, *arguments, erring=erring)
                rows.append({**asdict(result), "subject": task.subject, "case": task.case})
    if probes:
        without = [trial_of(task.case, side, "through", rng) for _ in range(2 * task.n_touches)]
        memory = learned(side, memory, bare(), without)
        ahead["without"] = activation_ahead(memory, probes)
        rows.append({"ahead": ahead})
    return rows


@cache
def bare() -> EncounterScene:
    """Return the robot as it takes itself to be."""
    return EncounterScene()


@cache
def world(side: Side, case: Case) -> EncounterScene:
    """Return the robot with its true surface."""
    parts = []
    for part in icub_skin().parts:
        cover_m = SLEEVE_M if case == "sleeve" and part.name.endswith("forearm") else 0.0
        parts.append(replace(part, positions_m=part.positions_m + cover_m * part.normals))
        if case == "stick" and part.name == f"{side}_palm":
            hand = part
    if case == "stick":
        along = np.array([1.0, 0.0, 0.0])  # of the palm's frame: the fingers'
        base = np.array([hand.positions_m[:, 0].max(), *hand.positions_m[:, 1:].mean(axis=0)])
        points = base + np.linspace(0, STICK_M, _STICK_POINTS + 1)[1:, None] * along
        normals = np.tile((along + hand.normals[0]) / np.sqrt(2), (_STICK_POINTS, 1))
        parts.append(SkinPart(f"{side}_stick", hand.frame, tuple(range(_STICK_POINTS)), points, normals))
    return EncounterScene(icub_setup(Skin(tuple(parts))))


def trial_of(
    case: Case, side: Side, condition: Condition, rng: np.random.Generator, path: DrawPath | None = None
) -> Trial:
    """Return a random encounter with the surface of a case, and the track of its object as the subject sees it."""
    scene = world(side, case)
    skin = scene.skins[side]
    aims = {"stick": _AIMED_AT, "sleeve": tuple(i for i in skin.taxel_ids if "forearm" in i), "radius": skin.taxel_ids}
    taxel = skin.index(str(rng.choice([i for i in skin.taxel_ids if i.endswith(aims[case])])))
    part = "palm" if case == "stick" else scene.body_part(skin.taxel_ids[taxel])
    stimulus: StimulusName = _OBJECTS[rng.integers(len(_OBJECTS))]
    speed_m_s = float(rng.uniform(*(TRAINING_SPEED_M_S if path else SPEED_M_S)))
    while True:
        posture = scene.robot.at(draw_posture(scene, side, part, rng))
        radius_m = make_stimulus(stimulus, fineness=0).radius_m
        aim = Aim(skin, posture, taxel, radius_m, speed_m_s, rng)
        for _ in range(_DRAWS):
            drawn = path or _PATHS[condition]
            if encounter := draw_visible(scene, aim, condition, side, part, stimulus, 0, drawn):
                return Trial(encounter, [_seen(case, track) for track in track_of(scene, encounter, rng)])


def _seen(case: Case, track: Track3D) -> Track3D:
    return replace(track, radius_m=track.radius_m - RADIUS_ERROR_M) if case == "radius" else track


def learned(side: Side, memory: PPSMemory, true: EncounterScene, trials: Sequence[Trial]) -> PPSMemory:
    """Return a subject's memory after more trials: touches beyond its skin tell it of a tool, as in `learn`."""
    skin = bare().skins[side]
    beyond = []
    for trial in trials:
        perceived = events_of(true, trial, None, None, believed=(bare(), memory))
        if (first := next((events for events in perceived if events.touched.any()), None)) is None:
            continue
        track = next(track for track in trial.tracks if track.stamp_s == first.stamp_s)
        end = TouchTrial.at_touch(track, trial.encounter.q_rad, first.touched[: len(skin.taxel_ids)])
        if touch := touch_beyond(bare().robot, bare().rig, skin, end, np.zeros(bare().robot.n_joints)):
            beyond.append(touch)
    memory = with_tool(memory, skin, beyond)
    for trial in trials:
        learning = LearnerState(memory)
        for events in events_of(true, trial, None, None, believed=(bare(), memory)):
            learning = observe(learning, events)
        memory = miss(finish(learning)).memory
    return memory


def activation_ahead(memory: PPSMemory, probes: Sequence[Trial]) -> float:
    """Return the mean over objects on their way to the stick of the highest activation half a second before contact."""
    highest = []
    for probe in probes:
        until_s = probe.encounter.contact_s - _LEAD_S
        seen = events_of(bare(), probe, None, None, believed=(bare(), memory))
        *_, events = (e for e in seen if e.stamp_s <= until_s)
        miss_m = np.nan if events.miss_m is None else events.miss_m
        highest.append(float(activation(memory, events.distance_m, events.ttc_s, miss_m).max()))
    return float(np.mean(highest)) if highest else np.nan


def _by_subject(rows: Rows, case: Case, name: str, key: str, is_harmless: bool) -> list[float]:
    chosen = [r for r in rows if r["case"] == case and r["controller"] == name]
    chosen = [r for r in chosen if (r["condition"] in HARMLESS) == is_harmless]
    subjects = sorted({r["subject"] for r in chosen})
    return interval([[100 * float(np.mean([not r[key] for r in chosen if r["subject"] == k]))] for k in subjects])


def tables(numbers: dict[str, Any]) -> dict[str, Table]:
    """Return a row for each case, and the activation ahead of a touch of the stick."""
    rows = []
    for case, cell in numbers["cases"].items():
        ours = cell[OURS]["untouched"]
        others = (estimate(cell[name]["untouched"]) for name in COMPARED[1:])
        rows.append([case, judged(estimate(ours), ours[0] < _GOAL), *others, estimate(cell[OURS]["still"])])
    stick = numbers["stick"]
    header = ["touches", *(after for after in stick if after != "without"), "then as many objects twice, no stick"]
    return {
        "": Table(["hazards untouched (%)", *COMPARED, "ours, passes: no command (%)"], rows),
        "stick": Table(header, [["activation", *(estimate(value) for value in stick.values())]]),
    }

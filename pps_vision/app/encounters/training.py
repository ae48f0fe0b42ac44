"""PPS memories learned without rendering, from as many approaches as R's robot had of each body part."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from learning.pps import learner
from learning.pps.joint_offsets import TouchTrial, verified_offsets
from learning.pps.learner import LearnerState
from learning.pps.memory import MemoryParams, PPSMemory
from learning.pps.receptive_field import CONE, NEAR, ReceptiveField
from pps_vision.app.encounters.encounter import (
    OBJECTS,
    SESSIONS,
    TRIALS,
    Condition,
    Encounter,
    EncounterScene,
    Part,
    approach,
    draw_one,
    felt,
    passing,
)
from pps_vision.app.encounters.robots import MiscalibratedRobot, true_robot
from pps_vision.app.encounters.tracks import track_of
from pps_vision.app.simulation import REACH_M, SPEED_M_S, Side
from pps_vision.robot.skin import touched_taxels
from pps_vision.types import Array, TaxelEvents, Track3D

BY_DISTANCE = MemoryParams(ttc_range_s=(-np.inf, np.inf), bins=(8, 1))  # a memory that knows D only: that of R's S2 Fig
_LEARNED_OBJECTS = 2  # of `OBJECTS`
_CONTACT_S = 0.7  # after the contact, the object withdraws later
_TOUCH = approach(REACH_M["approach"])  # until the surface is at a taxel's centre, as in the closed loop's training
_PASS = passing((0.0, 0.20))
_STREAM = 77  # keeps training and encounters of one seed apart


class Memories(NamedTuple):
    """Memories of one arm's skin."""

    probability: PPSMemory  # ours: from D, TTC and predicted miss distance, of touches and of objects that pass
    of_both: PPSMemory  # R's map: from D and TTC, of touches
    of_distance: PPSMemory  # from D alone
    constant: PPSMemory  # nothing learned: 1 wherever D and TTC lie within the ranges


MemoryName = Literal["probability", "of_both", "of_distance", "constant"]


class Trial(NamedTuple):
    """An object that touches or passes, and its track by eyes without systematic error."""

    encounter: Encounter
    tracks: Sequence[Track3D]


def learn(scene: EncounterScene, side: Side, seed: int, share: float = 1.0) -> Memories:
    """Return the memories after a share of R's numbers of approaches (Table 5) by ball and cube at 5–15 cm/s, and as
    many objects that pass."""
    return learn_from(scene, side, training_trials(scene, side, seed, share))


def training_trials(
    scene: EncounterScene, side: Side, seed: int, share: float = 1.0, parts: Collection[Part] | None = None
) -> Iterator[Trial]:
    """Yield the trials that `learn` learns from: approaches that touch these parts (default: all of the arm), and as
    many objects that pass at up to 20 cm, some of which touch too; of each part of another robot as many as of the
    inner forearm."""
    for j, part in enumerate(part for arm, part in scene.targets if arm == side):
        n = TRIALS[SESSIONS.get(part, "inner")]
        for k in range(max(round(share * n), 1) if parts is None or part in parts else 0):
            for path, is_pass in ((_TOUCH, False), (_PASS, True)):
                rng = np.random.default_rng((seed, _STREAM, side == "right", j, k, is_pass))
                speed = float(rng.uniform(*SPEED_M_S))
                stimulus = OBJECTS[k % _LEARNED_OBJECTS]
                condition: Condition = "harmless_passing" if is_pass else "press"
                encounter = draw_one(scene, condition, side, part, stimulus, speed, rng, k, path)
                yield Trial(encounter, track_of(scene, encounter, rng))


def learn_from(
    scene: EncounterScene,
    side: Side,
    trials: Iterable[Trial],
    robot: MiscalibratedRobot | None = None,
    rng: np.random.Generator | None = None,
    with_others: bool = True,
) -> Memories:
    """Return the memories after some trials, as an erring `robot` perceives them; `rng` draws its joints' slack.

    Without the others, only the probability is learned.
    """
    skin = scene.skins[side]
    ours = LearnerState(PPSMemory.empty(skin))
    both, distance = (LearnerState(PPSMemory.empty(skin, params)) for params in (MemoryParams(), BY_DISTANCE))
    for trial in trials:
        ours, both, distance = (LearnerState(state.memory) for state in (ours, both, distance))
        reading = None if robot is None or rng is None else robot.reading(rng)
        for events in events_of(scene, trial, robot, reading):
            ours = learner.observe(ours, events)
        for events in events_of(scene, trial, robot, reading, CONE) if with_others else ():
            both, distance = (learner.observe(state, events) for state in (both, distance))
        ours, both, distance = (learner.finish(state) for state in (ours, both, distance))
        ours = learner.miss(ours)
    return Memories(ours.memory, both.memory, distance.memory, PPSMemory.constant(skin))


def calibrate(trials: Iterable[Trial], robot: MiscalibratedRobot, rng: np.random.Generator) -> MiscalibratedRobot:
    """Return the robot after touches of seen objects: its encoders corrected where held-out touches clearly confirm
    it."""
    true, _, skin = true_robot()
    observed: list[TouchTrial] = []
    for encounter, tracks in trials:
        at_contact = next((track for track in tracks if track.is_known and track.stamp_s >= encounter.contact_s), None)
        if at_contact is None:
            continue
        reading = robot.reading(rng)
        (seen,) = robot.see([at_contact], encounter.q_rad, reading)
        taxels, _ = skin.at(true.at(encounter.q_rad))
        touched = touched_taxels(taxels, encounter.motion(seen.stamp_s)[0], encounter.radius_m)
        if seen.is_known and touched.any():
            observed.append(TouchTrial.at_touch(seen, encounter.q_rad + reading, touched))
    offsets_rad = verified_offsets(robot.model, robot.rig, robot.skin, observed).offsets_rad
    return replace(robot, joint_offsets_rad=robot.joint_offsets_rad + offsets_rad)


def events_of(
    scene: EncounterScene,
    trial: Trial,
    robot: MiscalibratedRobot | None,
    reading: Array | None,
    field: ReceptiveField = NEAR,
    believed: tuple[EncounterScene, PPSMemory] | None = None,
) -> Iterator[TaxelEvents]:
    """Yield what the skin at rest perceives during a trial, until 0.7 s after the touch: as `learner.step`, for all
    frames at once.

    `robot`, `reading`: a robot that errs, and the errors (n_joints,) of its encoders; `believed`: the scene as a robot
    without other error takes it to be, and the memory whose skin perceives.
    """
    encounter, tracks = trial
    tracks = [track for track in tracks if track.stamp_s <= encounter.contact_s + _CONTACT_S]
    taxels, _ = scene.skins[encounter.side].at(scene.robot.at(encounter.q_rad))
    model = believed[0] if believed else scene
    q = encounter.q_rad
    if robot is not None and reading is not None:
        model = robot.scene
        tracks = robot.see(tracks, q, reading)
        q = q + reading
    skin = model.skins[encounter.side]
    if believed:
        skin = believed[1].skin_of(skin)
    positions, normals = skin.at(model.robot.at(q))
    known = [track for track in tracks if track.is_known]
    if not known:
        return
    path = [(track.stamp_s, track.position) for track in known]
    recent = [learner.recent(path[:k], track.stamp_s) for k, track in enumerate(known)]
    velocities = [learner.path_velocities(track, earlier) for track, earlier in zip(known, recent, strict=True)]
    seen = np.array([track.position for track in known]), np.swapaxes(velocities, 0, 1)
    covs = np.array([track.cov[3:6, 3:6] for track in known])
    perceived = learner.perceive_path(field, positions, normals, *seen, known[0].radius_m, covs)
    by_stamp = dict(zip((track.stamp_s for track in known), zip(*perceived, strict=True), strict=True))
    unseen = (np.full(len(positions), np.nan),) * 3
    for track in tracks:
        touched = touched_taxels(taxels, encounter.motion(track.stamp_s)[0], encounter.radius_m)
        touched = felt(scene.skins[encounter.side], skin, touched)
        D, ttc, miss = by_stamp.get(track.stamp_s, unseen)
        yield TaxelEvents(track.stamp_s, skin.taxel_ids, D, ttc, touched, miss, track.radius_m)

"""PPS memories learned without rendering, from as many approaches as R's robot had of each body part."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np

from learning.pps import learner
from learning.pps.buffer import EventBuffer
from learning.pps.learner import LearnerState
from learning.pps.memory import MemoryParams, PPSMemory
from learning.pps.receptive_field import ReceptiveField, perceive
from pps_vision.app.encounters.encounter import OBJECTS, SESSIONS, TRIALS, Encounter, EncounterScene, approach, draw_one
from pps_vision.app.encounters.robots import MiscalibratedRobot
from pps_vision.app.encounters.tracks import track_of
from pps_vision.app.simulation import REACH_M, SPEED_M_S, Side
from pps_vision.robot.skin import touched_taxels
from pps_vision.types import TaxelEvents, Track3D

FIELD = ReceptiveField(distance_to="surface")
BY_DISTANCE = MemoryParams(ttc_range_s=(-np.inf, np.inf), bins=(8, 1))
"""A memory that knows D only: that of R's S2 Fig."""
_LEARNED_OBJECTS = 2  # of `OBJECTS`
_CONTACT_S = 0.7  # after the contact, the object withdraws later
_TOUCH = approach(REACH_M["approach"])  # until the surface is at a taxel's centre, as in the closed loop's training
_STREAM = 77  # keeps training and encounters of one seed apart


class Memories(NamedTuple):
    """Memories of one arm's skin."""

    of_both: PPSMemory  # from D and TTC
    of_distance: PPSMemory  # from D alone
    constant: PPSMemory  # nothing learned: 1 wherever D and TTC lie within the ranges


MemoryName = Literal["of_both", "of_distance", "constant"]


class Trial(NamedTuple):
    """An approach that ends with a touch, and its track by eyes without systematic error."""

    encounter: Encounter
    tracks: Sequence[Track3D]


def learn(scene: EncounterScene, side: Side, seed: int, share: float = 1.0) -> Memories:
    """Return the memories after a share of R's numbers of approaches (Table 5) by ball and cube at 5–15 cm/s."""
    return learn_from(scene, side, training_trials(scene, side, seed, share))


def training_trials(scene: EncounterScene, side: Side, seed: int, share: float = 1.0) -> Iterator[Trial]:
    """Yield the approaches that `learn` learns from."""
    for j, (part, session) in enumerate(SESSIONS.items()):
        for k in range(max(round(share * TRIALS[session]), 1)):
            rng = np.random.default_rng((seed, _STREAM, side == "right", j, k))
            speed = float(rng.uniform(*SPEED_M_S))
            touching = draw_one(scene, "press", side, part, OBJECTS[k % _LEARNED_OBJECTS], speed, rng, k, _TOUCH)
            yield Trial(touching, track_of(scene, touching, rng))


def learn_from(
    scene: EncounterScene,
    side: Side,
    trials: Iterable[Trial],
    robot: MiscalibratedRobot | None = None,
    rng: np.random.Generator | None = None,
) -> Memories:
    """Return the memories after some trials, as an erring `robot` perceives them; `rng` draws its joints' slack."""
    skin = scene.skins[side]
    states = [LearnerState(PPSMemory.empty(skin, p), EventBuffer()) for p in (MemoryParams(), BY_DISTANCE)]
    for trial in trials:
        states = [LearnerState(state.memory, EventBuffer()) for state in states]
        for events in _events(scene, trial, robot, rng):
            states = [learner.step(state, events) for state in states]
        states = [learner.finish(state) for state in states]
    return Memories(states[0].memory, states[1].memory, PPSMemory.constant(skin))


def _events(
    scene: EncounterScene, trial: Trial, robot: MiscalibratedRobot | None, rng: np.random.Generator | None
) -> Iterator[TaxelEvents]:
    """Yield the events of the skin at rest during an approach, until 0.7 s after the touch."""
    touching, tracks = trial
    taxels, _ = scene.skins[touching.side].at(scene.robot.at(touching.q_rad))
    believed = scene
    q = touching.q_rad
    if robot is not None and rng is not None:
        reading = robot.reading(rng)
        believed = robot.scene
        tracks = robot.see(tracks, q, reading)
        q = q + reading
    skin = believed.skins[touching.side]
    felt_at, normals = skin.at(believed.robot.at(q))
    D, ttc = np.full((2, len(taxels)), np.nan)
    for track in tracks:
        if track.stamp_s > touching.contact_s + _CONTACT_S:
            return
        touched = touched_taxels(taxels, touching.motion(track.stamp_s)[0], touching.radius_m)
        if track.is_known:
            stimulus = track.position, track.velocity, track.radius_m, track.cov[3:6, 3:6]
            D, ttc = perceive(FIELD, felt_at, normals, *stimulus)
        yield TaxelEvents(track.stamp_s, skin.taxel_ids, D, ttc, touched)

"""One frame of the skin: how each taxel perceives every object, what it learns from contacts, and the probability
of touch."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from learning.pps.buffer import LENGTH_S, EventBuffer, push
from learning.pps.memory import PPSMemory, activation, learn
from learning.pps.receptive_field import ReceptiveField, perceive
from learning.pps.tool import attributed
from pps_vision.geometry.paths import arrival_s, passing_distances
from pps_vision.types import Activation, Array, Mask, TaxelEvents, Track3D

_CONTACT_S = 0.6  # how long after its first touch a contact may reach further taxels: our choice
_PATH_S = 0.1, 0.25  # ages of the positions whose differences confirm the closing speed
_EPS_S = 1e-6

Path = tuple[tuple[float, Array], ...]
"""Stamps and positions (3,) m of an object, oldest first."""


@dataclass(frozen=True)
class Contact:
    """A contact that has not ended."""

    since_s: float  # stamp of its first touch
    touched: Mask  # (n,) taxels it has reached
    learned: bool = False  # whether it was learned from


@dataclass(frozen=True)
class LearnerState:
    """State of online learning."""

    memory: PPSMemory  # the learned memory
    buffer: EventBuffer = EventBuffer()  # samples before the contact; none is added while a contact lasts
    contact: Contact | None = None  # the contact that lasts; None without a touch
    paths: Mapping[int, Path] = field(default_factory=dict)  # positions of each track in the last quarter second
    stale: int = 0  # samples rejected because their stamp is not finite or does not advance
    unseen: int = 0  # contacts without a perceived sample before them, from which nothing was learned


class SkinFrame(NamedTuple):
    """Input of one frame: the skin in the root frame, and the objects about it."""

    stamp_s: float
    taxel_ids: tuple[str, ...]  # names of the n taxels
    positions: Array  # (n, 3) m
    normals: Array  # (n, 3) unit normals
    touched: Mask  # (n,) the skin's report
    tracks: Sequence[Track3D]  # tracked objects; unknown ones are ignored
    attended_id: int = 0  # the track that is learned from
    margins: Array | float = 1.0  # (n,) factors by which objects count as nearer than they are


class SkinStep(NamedTuple):
    """Output of one frame."""

    events: TaxelEvents  # the attended track as the taxels perceive it
    tracks: list[Track3D]  # the m known objects
    by_track: Array  # (m, n) activation of every taxel by each of them
    activation: Activation  # the highest of these; 1 where the skin is touched (R: the neurons are bimodal)


def step(params: ReceptiveField, state: LearnerState, skin: SkinFrame) -> tuple[LearnerState, SkinStep]:
    """Perceive all tracks, learn from the attended one, and return the activations by the memory after that."""
    tracks = [track for track in skin.tracks if track.is_known]
    earlier = {t.track_id: recent(state.paths.get(t.track_id, ()), skin.stamp_s) for t in tracks}
    perceived = [
        perceive_path(
            params,
            skin.positions,
            skin.normals,
            track.position,
            path_velocities(track, earlier[track.track_id]),
            track.radius_m,
            track.cov[3:6, 3:6],
        )
        for track in tracks
    ]
    unseen = (np.full(len(skin.taxel_ids), np.nan),) * 3
    attended = next((p for p, t in zip(perceived, tracks, strict=True) if t.track_id == skin.attended_id), unseen)
    D, ttc, miss = attended
    radius_m = next((track.radius_m for track in tracks if track.track_id == skin.attended_id), 0.0)
    events = TaxelEvents(skin.stamp_s, skin.taxel_ids, D, ttc, skin.touched, miss, radius_m)
    paths = {t.track_id: (*earlier[t.track_id], (skin.stamp_s, t.position)) for t in tracks}
    state = replace(observe(state, events), paths=paths)
    nearer = [[place / skin.margins for place in places] for places in perceived]
    by_track = np.reshape([activation(state.memory, *places) for places in nearer], (len(tracks), len(D)))
    highest = np.maximum(by_track.max(axis=0, initial=0.0), skin.touched)
    return state, SkinStep(events, tracks, by_track, Activation(skin.stamp_s, skin.taxel_ids, highest))


def recent(path: Sequence[tuple[float, Array]], stamp_s: float) -> Path:
    """The positions of the last quarter second before a stamp; if there is none, the newest before it."""
    earlier = tuple(at for at in path if at[0] < stamp_s)
    return tuple(at for at in earlier if stamp_s - _PATH_S[1] - _EPS_S <= at[0]) or earlier[-1:]


def path_velocities(track: Track3D, path: Path) -> Array:
    """(3, 3) m/s velocities of an object: the filter's, and its positions' since 0.1 s and up to 0.25 s ago; 0
    while there are none: a new track's velocity is not confirmed."""
    since = [(track.stamp_s - stamp_s, p) for stamp_s, p in path if track.stamp_s - stamp_s >= _PATH_S[0] - _EPS_S]
    by_positions = [(track.position - p) / age_s for age_s, p in since[-1:] + since[:1]]
    return np.array([track.velocity, *(by_positions or np.zeros((2, 3)))])


def perceive_path(
    params: ReceptiveField, positions: Array, normals: Array, p: Array, velocities: Array, radius_m: float, cov_v: Array
) -> tuple[Array, Array, Array]:
    """D, TTC and predicted miss distance (…, n) of an object for taxels at `positions` (n, 3) with unit `normals`.

    Args:
        params: The taxels' receptive field.
        positions: Root frame.
        normals: Root frame.
        p: Positions (…, 3) of the object in the root frame.
        velocities: (3, …, 3), as `path_velocities` returns them.
        radius_m: Radius of the object.
        cov_v: Covariance (…, 3, 3) of the filter's velocity.

    The closing speed is the smallest of the three: the filter's overshoots when an object stops, the positions do not.
    The path of which the miss distance is predicted ends where the object's surface meets the skin: taxels beyond the
    one that is hit are not touched.  An object that touches and moves away has no TTC.  Taxels count as at rest, so
    that the activation persists while the arm withdraws, and its own motion causes none.
    """
    D, times = perceive(params, positions, normals, p, velocities, radius_m, cov_v)
    towards = np.einsum("...nj,k...j->k...n", positions - p[..., None, :], velocities)
    ttc = np.where((towards > 0).all(axis=0), times.max(axis=0), np.where(times[0] < 0, times[0], np.inf))
    shell_m = max(radius_m, 0.0)
    arrival = arrival_s(positions, p, velocities[0], shell_m)
    miss = passing_distances(positions, p, velocities[0], arrival) - shell_m
    return D[0], np.where(np.isnan(D[0]), np.nan, ttc), miss


def observe(state: LearnerState, events: TaxelEvents) -> LearnerState:
    """Add one sample; the memory changes once for every contact, when it ends or is `_CONTACT_S` old.

    A touch of a tool is one of its places.  A stamp that goes back by more than the buffer's length means that the
    clock was reset: the buffer is emptied.
    """
    events = attributed(state.memory, events)
    ahead_s = events.stamp_s - state.buffer[-1].stamp_s if state.buffer else np.inf
    if not np.isfinite(events.stamp_s) or -LENGTH_S <= ahead_s <= 0:
        return replace(state, stale=state.stale + 1)
    if ahead_s < 0:
        state = replace(state, buffer=EventBuffer(), contact=None)
    touching = bool(np.any(events.touched))
    if state.contact is None:
        contact = Contact(events.stamp_s, events.touched) if touching else None
        return replace(state, buffer=push(state.buffer, events), contact=contact)
    contact = replace(state.contact, touched=state.contact.touched | events.touched)
    state = replace(state, contact=contact)
    if not touching or events.stamp_s - contact.since_s >= _CONTACT_S:
        state = finish(state)
    return state if touching else replace(state, contact=None)


def finish(state: LearnerState) -> LearnerState:
    """Learn from a contact that has not ended, as at the end of a recording; once only."""
    if state.contact is None or state.contact.learned:
        return state
    memory = learn(state.memory, state.buffer, state.contact.touched)
    return replace(
        state,
        memory=memory,
        buffer=EventBuffer(),
        contact=replace(state.contact, learned=True),
        unseen=state.unseen + (memory is state.memory),
    )


def miss(state: LearnerState) -> LearnerState:
    """Learn from the samples since the last contact that nothing was touched; not while a contact lasts."""
    if state.contact is not None:
        return state
    return replace(state, memory=learn(state.memory, state.buffer, None), buffer=EventBuffer())

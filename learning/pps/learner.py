"""Online learning: buffer the taxels' perception and learn once from every contact."""

from dataclasses import dataclass, replace

import numpy as np

from learning.pps.buffer import LENGTH_S, EventBuffer, push
from learning.pps.memory import PPSMemory, learn
from pps_vision.types import Mask, TaxelEvents

_CONTACT_S = 0.6  # how long after its first touch a contact may reach further taxels: our choice


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
    buffer: EventBuffer  # samples before the contact; it takes no more while a contact lasts
    contact: Contact | None = None  # the contact that lasts; None without a touch
    stale: int = 0  # samples rejected because their stamp is not finite or does not advance
    unseen: int = 0  # contacts without a perceived sample before them, from which nothing was learned


def step(state: LearnerState, events: TaxelEvents) -> LearnerState:
    """Add one sample; the memory changes once for every contact, when it ends or is `_CONTACT_S` old.

    A stamp that goes back by more than the buffer's length means that the clock was reset: the buffer is emptied.
    """
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

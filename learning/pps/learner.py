"""Learning as things happen: buffer what is perceived, and learn once from every contact."""

from dataclasses import dataclass, replace

import numpy as np

from learning.pps.buffer import EventBuffer, push
from learning.pps.memory import PPSMemory, learn
from pps_vision.types import Mask, TaxelEvents


@dataclass(frozen=True)
class LearnerParams:
    """How long after the first touch further taxels may join the same contact."""

    contact_s: float = 0.6


@dataclass(frozen=True)
class Contact:
    """A touch that goes on: its start, the taxels (n,) it reached so far, whether it was learned."""

    since_s: float
    touched: Mask
    learned: bool = False


@dataclass(frozen=True)
class LearnerState:
    """The buffer stops at the first touch, so that a contact is learned from what came before it.

    Counted since the start: `stale` samples, rejected because their stamp is no number or does not advance,
    and `unseen` contacts, of which nothing was learned because nothing had been perceived before them.
    """

    memory: PPSMemory
    buffer: EventBuffer
    contact: Contact | None = None
    stale: int = 0
    unseen: int = 0


def step(params: LearnerParams, state: LearnerState, events: TaxelEvents) -> LearnerState:
    """The state after one more sample; the memory changes once for every contact, when it is over
    or `contact_s` old.  A clock that goes back by more than the buffer's length was set anew."""
    samples = state.buffer.samples
    ahead_s = events.stamp_s - samples[-1].stamp_s if samples else np.inf
    if not np.isfinite(events.stamp_s) or -state.buffer.params.length_s <= ahead_s <= 0:
        return replace(state, stale=state.stale + 1)
    if ahead_s < 0:
        state = replace(state, buffer=EventBuffer(state.buffer.params), contact=None)
    touching = bool(np.any(events.touched))
    if state.contact is None:
        contact = Contact(events.stamp_s, events.touched) if touching else None
        return replace(state, buffer=push(state.buffer, events), contact=contact)
    contact = state.contact
    if not contact.learned:
        contact = replace(contact, touched=contact.touched | events.touched)
        state = replace(state, contact=contact)
    if not touching or events.stamp_s - contact.since_s >= params.contact_s:
        state = finish(state)
    return state if touching else replace(state, contact=None)


def finish(state: LearnerState) -> LearnerState:
    """Learn a contact that goes on, as at the end of a recording; once only."""
    if state.contact is None or state.contact.learned:
        return state
    memory = learn(state.memory, state.buffer, state.contact.touched)
    return replace(
        state,
        memory=memory,
        buffer=EventBuffer(state.buffer.params),
        contact=replace(state.contact, learned=True),
        unseen=state.unseen + (memory is state.memory),
    )

"""One learning iteration a contact, for touches of any order and length."""

from dataclasses import replace

import numpy as np
import pytest

from learning.pps.buffer import EventBuffer
from learning.pps.learner import LearnerState, finish, miss, step
from learning.pps.memory import PPSMemory
from pps_vision.robot.skin import icub_skin
from pps_vision.types import TaxelEvents

SKIN = icub_skin(("left_palm",))


def run(touches, state=None, start=0.0):
    """Feed 20 Hz samples; `touches` lists the taxels touched at each."""
    state = state or LearnerState(PPSMemory.empty(SKIN), EventBuffer())
    for i, taxels in enumerate(touches):
        touched = np.isin(np.arange(4), taxels)
        events = TaxelEvents(start + 0.05 * i, SKIN.taxel_ids, np.full(4, 0.1), np.ones(4), touched)
        state = step(state, events)
    return state


def samples(state):
    return state.memory.counts.sum(axis=(1, 2)).tolist()


@pytest.mark.parametrize(
    ("touches", "expected"),
    [
        ([[]] * 40, [[0, 0]] * 4),  # no touch teaches nothing
        ([[]] * 10 + [[0], [0, 2], []], [[11, 0], [0, 11], [11, 0], [0, 11]]),  # one after the other: one contact
        ([[]] * 10 + [[1]] * 12, [[0, 0]] * 4),  # 0.55 s: it has not ended
        ([[]] * 10 + [[1]] * 13, [[0, 11], [11, 0], [0, 11], [0, 11]]),  # it lasts
        ([[]] * 10 + [[1]] * 13 + [[]] * 3, [[0, 11], [11, 0], [0, 11], [0, 11]]),  # its end teaches nothing more
        ([[]] * 10 + [[0], []] + [[]] * 5 + [[0], []], [[11 + 6, 0]] + [[0, 17]] * 3),  # each from a fresh buffer
    ],
)
def test_a_touch_is_learned_when_it_ends_or_lasts(touches, expected):
    assert samples(run(touches)) == expected


def test_a_contact_cut_off_by_the_end_can_be_finished_once():
    """And is no miss."""
    cut_off = run([[]] * 4 + [[3]])
    assert miss(cut_off) is cut_off
    state = finish(cut_off)
    assert samples(state) == [[0, 5]] * 3 + [[5, 0]]
    assert finish(state) is state


def test_a_miss_is_negative_for_every_taxel_once():
    state = miss(run([[]] * 10 + [[1], []] + [[]] * 5))
    assert samples(state) == [[0, 11 + 5], [11, 5], [0, 16], [0, 16]]
    assert samples(miss(state)) == samples(state)


def test_a_stale_sample_is_rejected_and_counted():
    """A frozen clock, a stamp that is no number, one late by no more than the buffer's 3 s: only the count changes."""
    events = [
        TaxelEvents(t, SKIN.taxel_ids, np.full(4, 0.1), np.ones(4), np.zeros(4, bool)) for t in (1.0, 1.0, 0.9, -2.0)
    ]
    events += [replace(events[0], stamp_s=t) for t in (np.nan, np.inf, -np.inf)]
    state = LearnerState(PPSMemory.empty(SKIN), EventBuffer())
    for sample in events:
        state = step(state, sample)
    assert (len(state.buffer), state.stale, state.unseen) == (1, 6, 0)


@pytest.mark.parametrize(("last", "start_s"), [([], 1e9), ([[0]], 20.0)])
def test_after_a_reset_clock_learning_goes_on(last, start_s):
    """It ends a contact, which teaches nothing."""
    state = run([[]] * 10 + last, start=start_s)
    assert (state.contact is not None) == bool(last)
    state = run([[]] * 10 + [[1], []], state, start=5.0)
    assert samples(state) == [[0, 11], [11, 0], [0, 11], [0, 11]]
    assert state.stale == 0


def test_a_touch_by_an_unseen_object_teaches_nothing_and_is_counted():
    state = LearnerState(PPSMemory.empty(SKIN), EventBuffer())
    nothing = np.full(4, np.nan)
    for k in range(20):
        touched = np.arange(4) == (2 if k == 15 else -1)
        state = step(state, TaxelEvents(0.05 * k, SKIN.taxel_ids, nothing, nothing, touched))
    assert samples(state) == [[0, 0]] * 4
    assert (state.stale, state.unseen) == (0, 1)

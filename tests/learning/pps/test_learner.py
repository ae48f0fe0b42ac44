"""One learning iteration a contact, for touches of any order and length; the event buffer and its 50 ms grid."""

from dataclasses import replace

import numpy as np
import pytest
from known_track import touched_on_course
from tracks import track_at

from learning.pps.buffer import EventBuffer, push, resample
from learning.pps.learner import LearnerState, SkinFrame, finish, miss, observe, step
from learning.pps.memory import MemoryParams, PPSMemory
from learning.pps.receptive_field import NEAR
from pps_vision.robot.skin import Skin, icub_skin
from pps_vision.types import TaxelEvents

SKIN = icub_skin(("left_palm",))


def run(touches, state=None, start=0.0):
    """Feed 20 Hz samples; `touches` lists the taxels touched at each."""
    state = state or LearnerState(PPSMemory.empty(SKIN, MemoryParams()))
    for i, taxels in enumerate(touches):
        touched = np.isin(np.arange(4), taxels)
        events = TaxelEvents(start + 0.05 * i, SKIN.taxel_ids, np.full(4, 0.1), np.ones(4), touched)
        state = observe(state, events)
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
    state = LearnerState(PPSMemory.empty(SKIN, MemoryParams()))
    for sample in events:
        state = observe(state, sample)
    assert (len(state.buffer), state.stale, state.unseen) == (1, 6, 0)


@pytest.mark.parametrize(("last", "start_s"), [([], 1e9), ([[0]], 20.0)])
def test_after_a_reset_clock_learning_goes_on(last, start_s):
    """It ends a contact, which teaches nothing."""
    state = run([[]] * 10 + last, start=start_s)
    assert (state.contact is not None) == bool(last)
    state = run([[]] * 10 + [[1], []], state, start=5.0)
    assert samples(state) == [[0, 11], [11, 0], [0, 11], [0, 11]]
    assert state.stale == 0


def sample(stamp_s, distance_m, ttc_s):
    return TaxelEvents(stamp_s, ("a", "b"), np.array(distance_m), np.array(ttc_s), np.array([False, False]))


def filled(stamps, distance=lambda t: 0.2 - 0.05 * t, ttc=lambda t: 4 - t):
    buffer = EventBuffer()
    for t in stamps:
        buffer = push(buffer, sample(t, [distance(t), np.nan], [ttc(t), np.nan]))
    return buffer


def series(buffer: EventBuffer) -> tuple[np.ndarray, np.ndarray]:
    """D and TTC (T, 2) of both taxels, NaN of one without a sample."""
    taxels, *perceived, _ = resample(buffer, np.arange(2))
    D, TTC = np.full((2, len(perceived[0]), 2), np.nan)
    D[:, taxels], TTC[:, taxels] = perceived
    return D, TTC


@pytest.mark.parametrize("step_s", [0.05, 1 / 30, 0.04, 0.1])
def test_grid_of_50_ms_back_from_the_last_sample(step_s):
    stamps = np.arange(0, 2.01, step_s)
    D, TTC = series(filled(stamps))
    times = stamps[-1] - 0.05 * np.arange(int(stamps[-1] / 0.05 + 1e-6), -1, -1)
    np.testing.assert_allclose(D[:, 0], 0.2 - 0.05 * times, atol=1e-9)  # linear in time: interpolation is exact
    np.testing.assert_allclose(TTC[:, 0], 4 - times, atol=1e-9)
    assert np.isnan(D[:, 1]).all()


@pytest.mark.parametrize(("gap_s", "is_bridged"), [(0.14, True), (0.2, False)])
def test_a_gap_of_less_than_three_steps_is_bridged_and_one_of_four_is_not(gap_s, is_bridged):
    D, _ = series(filled([0.0, 0.05, 0.05 + gap_s, 0.1 + gap_s]))
    assert np.isfinite(D[2:-2, 0]).all() == is_bridged


def test_refuses_a_stamp_that_does_not_advance_and_other_taxels():
    buffer = filled([1.0])
    events = TaxelEvents(2.0, ("a",), np.zeros(1), np.zeros(1), np.zeros(1, bool))
    for wrong, message in ((sample(1.0, [0.1, 0.1], [1.0, 1.0]), "stamp 1.0 s after 1.0 s"), (events, "own taxels")):
        with pytest.raises(ValueError, match=message):
            push(buffer, wrong)
    with pytest.raises(ValueError, match="a buffer without samples"):
        resample(EventBuffer(), np.arange(2))


def test_a_part_with_a_wider_margin_expects_what_would_miss_another():
    """A ball passes the palm at 3 cm; with twice the margin that counts as 1.5 cm."""
    skin = Skin(tuple(replace(part, margin=factor) for part, factor in zip(SKIN.parts, (2.0,), strict=True)))
    part = SKIN.parts[0]
    center = part.positions_m[0] + (0.03 + 0.02) * part.normals[0]
    velocity = 0.1 * np.cross(part.normals[0], [1.0, 0.0, 0.0])
    highest = []
    for margins in (SKIN.margins, skin.margins):
        state = LearnerState(touched_on_course(SKIN))
        for t in (0.0, 0.1):
            track = track_at(center + (t - 0.7) * velocity, velocity, t, radius_m=0.02)
            frame = SkinFrame(
                t, SKIN.taxel_ids, part.positions_m, part.normals, np.zeros(4, bool), [track], margins=margins
            )
            state, felt = step(NEAR, state, frame)
            highest.append(felt.activation.probability[0])
    new, narrow, _, wide = highest
    assert new == 0  # a new track's velocity is not confirmed
    assert narrow < 0.2
    assert wide > 0.6

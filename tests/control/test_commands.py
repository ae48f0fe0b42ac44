"""One command from several controllers, and where a robot that obeys late will be, against a clock with small ticks."""

import numpy as np
import pytest

from control.commands import Prediction, combine, posture_after, predict
from pps_vision.types import JointVelocity


def command(*rates: float, stamp_s: float = 0.5, hold_s: float = 0.4) -> JointVelocity:
    return JointVelocity(stamp_s, np.array(rates), hold_s)


def test_disjoint_commands_are_added():
    combined = combine([command(0.1, 0.0, -0.2), command(0.0, 0.3, 0.0)])
    np.testing.assert_array_equal(combined.dq_rad_s, [0.1, 0.3, -0.2])
    assert (combined.stamp_s, combined.hold_s) == (0.5, 0.4)
    np.testing.assert_array_equal(combine([command(0.1, 0.0)]).dq_rad_s, [0.1, 0.0])


@pytest.mark.parametrize(
    ("commands", "message"),
    [
        ([command(0.1, 0.2), command(0.0, -0.2)], r"joints \[1\] are commanded twice"),
        ([command(0.1, 0.0), command(0.0, 0.2, stamp_s=0.6)], r"validities \[\(0.5, 0.4\), \(0.6, 0.4\)\]"),
        ([command(0.1, 0.0), command(0.0, 0.2, hold_s=0.3)], r"validities \[\(0.5, 0.3\), \(0.5, 0.4\)\]"),
        ([command(0.1, 0.0), command(0.0)], r"shapes \[\(1,\), \(2,\)\]"),
        ([command(0.1, np.nan)], "expected finite"),
        ([], r"expected one of each"),
    ],
)
def test_commands_that_do_not_combine_are_refused(commands, message):
    with pytest.raises(ValueError, match=message):
        combine(commands)


@pytest.mark.parametrize("latency_s", [0.0, 0.03, 0.1, 0.23])
def test_the_commands_on_the_way_are_obeyed_in_turn(rng, latency_s):
    stamps = np.cumsum(rng.uniform(0.02, 0.2, 6))
    commands = [JointVelocity(float(t), rng.normal(size=3), 0.1) for t in stamps]  # some end before the next
    q0 = rng.normal(size=3)
    from_s = 0.11
    until_s = 0.9
    expected = q0.copy()
    ticks = np.arange(from_s, until_s, 1e-4)
    for t in ticks:
        begun = [c for c in commands if c.stamp_s + latency_s <= t]
        if begun and t < begun[-1].stamp_s + latency_s + begun[-1].hold_s:
            expected += 1e-4 * begun[-1].dq_rad_s
    np.testing.assert_allclose(posture_after(q0, commands, from_s, until_s, latency_s), expected, atol=2e-3)


@pytest.mark.parametrize(("late_s", "frames_old"), [(0.0, 0), (0.0, 1), (0.05, 0), (0.13, 0), (0.3, 0), (0.1, 1)])
@pytest.mark.parametrize("stated_s", [0.0, 0.1])
def test_the_prediction_is_the_true_posture_whatever_the_delay(rng, stated_s, late_s, frames_old):
    """Of a robot that begins at rest; the reported one differs from it unless the delay is the stated one."""
    q = start = rng.normal(size=3)
    now_s = 0.0
    commands = []
    readings = [q] * (frames_old + 1)
    prediction = None
    for k in range(40):
        at_effect = posture_after(readings[-1 - frames_old], commands, now_s, now_s + stated_s, stated_s)
        prediction = predict(prediction, commands, readings[-1 - frames_old], at_effect, now_s)
        truth = posture_after(q, commands, now_s, now_s + late_s, late_s)
        np.testing.assert_allclose(prediction.q_rad, truth, atol=1e-12)
        rates = np.array([0.0, 0.2, -0.4]) * (k > 2) + np.array([0.5, 0.0, 0.0]) * (k % 7)
        commands.append(JointVelocity(now_s, rates, 0.3))
        until_s = now_s + float(rng.uniform(0.02, 0.2))
        q = posture_after(q, commands, now_s, until_s, late_s)
        now_s = until_s
        readings.append(q)
    assert np.abs(q - start).max() > 1.0
    is_as_stated = late_s == stated_s and frames_old == 0
    assert (prediction.repeated_rad < 1e-12) == is_as_stated


def test_a_robot_that_was_pushed_is_where_it_reports_to_be_as_soon_as_it_rests():
    q = np.zeros(2)
    at_rest = [command(0.0, 0.0, stamp_s=0.1 * k) for k in range(3)]
    prediction = predict(predict(None, (), q, q, 0.0), at_rest[:1], q + 0.2, q + 0.2, 0.1)
    np.testing.assert_array_equal(prediction.q_rad, q + 0.2)
    assert prediction.differences == ((0.1, 0.2),)
    assert predict(prediction, at_rest[:2], q + 0.2, q + 0.2, 0.2).repeated_rad == 0.0


def test_the_prediction_of_a_robot_that_does_not_obey_leaves_it_no_further_than_its_commands_lead():
    """Its joints stand at 0, and are commanded to turn up and down."""
    q = np.zeros(2)
    commands = [command(0.5, -0.5, stamp_s=0.1 * k, hold_s=0.1) for k in range(5)]
    prediction = Prediction(np.array([0.3, 0.3]))
    prediction = predict(prediction, commands, q, q, 0.5)
    np.testing.assert_allclose(prediction.q_rad, [0.25, 0.0], atol=1e-12)


def test_a_difference_counts_if_two_frames_of_a_second_or_the_last_two_show_it():
    q = np.zeros(1)

    def repeated(*frames: tuple[float, float]) -> float:
        prediction = predict(None, (), q, q, 0.0)
        commands = [command(0.0, stamp_s=0.0)]
        for stamp_s, reading in frames:
            prediction = predict(Prediction(q, prediction.differences), commands, q + reading, q + reading, stamp_s)
            commands = [command(0.0, stamp_s=stamp_s)]
        return prediction.repeated_rad

    assert repeated((1.0, 0.3)) == 0.0
    assert repeated((1.0, 0.3), (1.9, 0.2)) == 0.2
    assert repeated((1.0, 0.3), (1.5, 0.0), (1.9, 0.2)) == 0.2
    assert repeated((1.0, 0.3), (1.5, 0.0), (2.1, 0.2)) == 0.0
    assert repeated((1.0, 0.3), (4.0, 0.2)) == 0.2

"""Sum of the commands of the arm and gaze controllers, and the posture that earlier commands lead to."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pps_vision.errors import InputError
from pps_vision.types import Array, JointVelocity

MAX_LATE_S = 0.5  # longest time by which commands may take effect or be reported later than assumed
_RECENT_S = 1.0  # time in which a difference from the prediction must be repeated; the last frame's always counts


def combine(commands: Sequence[JointVelocity]) -> JointVelocity:
    """The sum of one or more velocity commands that move disjoint sets of joints, not yet within limits.

    InputError if two commands move one joint, their stamps, validities or lengths differ, or a rate is not finite.
    """
    times = {(command.stamp_s, command.hold_s) for command in commands}
    shapes = {command.dq_rad_s.shape for command in commands}
    if len(times) != 1 or len(shapes) != 1:
        differing = f"stamps and validities {sorted(times)} s and shapes {sorted(shapes)}"
        raise InputError("arbiter", f"commands of {differing}; expected one of each")
    rates = np.array([command.dq_rad_s for command in commands])
    if not np.isfinite(rates).all():
        raise InputError("arbiter", f"joint rates {rates}; expected finite numbers in rad/s")
    shared = np.flatnonzero(np.count_nonzero(rates, axis=0) > 1)
    if shared.size:
        raise InputError("arbiter", f"joints {shared.tolist()} are commanded twice; expected disjoint sets of joints")
    stamp_s, hold_s = times.pop()
    return JointVelocity(stamp_s, rates.sum(axis=0), hold_s)


def posture_after(q: Array, commands: Sequence[JointVelocity], from_s: float, to_s: float, latency_s: float) -> Array:
    """The configuration (n_joints,) at `to_s` of a robot at `q` at `from_s` that obeys `commands`.

    Each of the commands, in order of stamps, takes effect `latency_s` later, until the next one does or it expires.
    """
    for k, command in enumerate(commands):
        begin = command.stamp_s + latency_s
        end = begin + command.hold_s
        if k + 1 < len(commands):
            end = min(end, commands[k + 1].stamp_s + latency_s)
        obeyed_s = max(min(end, to_s) - max(begin, from_s), 0.0)
        q = q + obeyed_s * command.dq_rad_s
    return q


@dataclass(frozen=True, slots=True)
class Prediction:
    """Posture by dead reckoning: the sum of all commands, whenever they take effect and whenever that is reported."""

    q_rad: Array  # (n_joints,) when the last command takes effect
    differences: tuple[tuple[float, float], ...] = ()
    """Stamps, and largest differences (rad) of a joint's reported posture from the prediction, of the last second."""

    @property
    def repeated_rad(self) -> float:
        """The difference that two frames of the last second reach."""
        return sorted((0.0, 0.0, *(difference for _, difference in self.differences)))[-2]


def predict(
    prediction: Prediction | None, commands: Sequence[JointVelocity], q_rad: Array, at_effect_rad: Array, stamp_s: float
) -> Prediction:
    """Advance the prediction to the effect of a command at `stamp_s`, after earlier `commands`.

    It stays among the postures that lead from the encoders' `q_rad` (n_joints,) by commands that these do not show yet,
    from none to all: a robot that was pushed is where it reports to be as soon as it rests.  `at_effect_rad` is the
    reported posture at the effect of the command, if the latency and the readings' age are the stated ones.
    """
    if prediction is None or not commands:
        return Prediction(at_effect_rad)
    ends_s = [*(command.stamp_s for command in commands[1:]), stamp_s]
    turns = [min(end - c.stamp_s, c.hold_s) * c.dq_rad_s for c, end in zip(commands, ends_s, strict=True)]
    unseen = np.cumsum([np.zeros_like(q_rad), *reversed(turns)], axis=0)
    predicted = prediction.q_rad + turns[-1]
    difference = float(np.abs(at_effect_rad - predicted).max())
    earlier = prediction.differences
    recent = [entry for entry in earlier[:-1] if entry[0] >= stamp_s - _RECENT_S]
    predicted = np.clip(predicted, q_rad + unseen.min(axis=0), q_rad + unseen.max(axis=0))
    return Prediction(predicted, (*recent, *earlier[-1:], (stamp_s, difference)))

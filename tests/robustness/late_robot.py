"""A robot that obeys or reports later than its pipeline assumes, under the adversary's tracks; its true posture counts.

Commands take effect after the true latency, and the encoders' readings are some frames old.  It begins at rest.
"""

from itertools import pairwise

import numpy as np
from adversary import BLACK, DISTANCE_TOLERANCE_M, LIMITS, TOLERANCE, AttackResult, Episode, attack

from control.commands import posture_after
from pps_vision.app.pipeline import PipelineStep
from pps_vision.types import Array, JointVelocity, StereoFrame

_VISIBLE_RAD = np.deg2rad(0.1)  # change of a reading: twice the resolution of an iCub's encoder


class LateResult(AttackResult):
    """Findings of an attack on a robot with its own timing."""

    def __init__(self) -> None:
        super().__init__()
        self.limits_left = 0  # instants at which a joint was beyond a limit, and further than at the start
        self.beyond_rad = 0.0  # largest
        self.said_after_s: list[float] = []  # by episode, to the first report from the mismatch that it is about
        self.unsaid: list[str] = []  # frames without a report of a mismatch visible in two frames of the last second
        self.said_in_vain: list[str] = []  # episodes that began with a report without a visible mismatch


def attack_late(
    steps: int, seed: int, episode_steps: int, stated_s: float, true_s: float, frames_old: int
) -> LateResult:
    """`attack` a robot of the latency `true_s`, where `stated_s` is assumed, and encoders `frames_old`."""

    class Late(_LateEpisode):
        latency_s = stated_s
        true_latency_s = true_s
        age = frames_old

    result = LateResult()
    attack(steps, seed, episode_steps, Late, result)
    return result


class _LateEpisode(Episode):
    """One start, one kind of path."""

    true_latency_s: float
    age: int  # age of the encoders' readings, frames
    result: LateResult

    def run(self, steps: int) -> None:
        """Let the adversary act for `n` frames, in the order of time and at most 1 s apart."""
        self.commands: list[JointVelocity] = []
        self.readings: list[Array] = []  # at every frame
        self.assumed = self.q  # posture of a robot with the stated latency
        self.visible_s: list[float] = []  # frames of the last second with a visible mismatch
        self.said = False
        self.start_excess = self._excess()
        for _ in range(steps):
            given_s = self._next_stamp()
            if np.isfinite(given_s):
                given_s = float(np.clip(given_s, self.stamp_s, self.stamp_s + 1.0))
                self._move(given_s)
                self.readings.append(self.q)
            reading = self.readings[max(len(self.readings) - 1 - self.age, 0)] if self.readings else self.q
            self.tracker.track = self._track(given_s)
            joints = np.full_like(self.q, np.nan) if self.rng.random() < 0.005 else reading
            step = self._step(StereoFrame(BLACK, BLACK, given_s, given_s, joints, joints))
            self.result.steps += 1
            if step is not None:
                self.commands.append(step.command)
                self.taxels = self.skin.at(step.posture)
                self.result.modes[step.response.mode] += 1
                self._listen(reading, step)

    def _move(self, until_s: float) -> None:
        """Obey until a stamp, and judge the true posture wherever a rate changes, and between."""
        late_s = self.true_latency_s
        times = [self.stamp_s, until_s]
        for command in self.commands:
            begin_s = command.stamp_s + late_s
            times += [t for t in (begin_s, begin_s + command.hold_s) if self.stamp_s < t < until_s]
        times.sort()
        for a, b in pairwise(times):
            for from_s, to_s in ((a, 0.5 * (a + b)), (0.5 * (a + b), b)):
                moved = posture_after(self.q, self.commands, from_s, to_s, late_s)
                if np.any(moved != self.q):
                    self.q = moved
                    self._judge()
        self.assumed = posture_after(self.assumed, self.commands, self.stamp_s, until_s, self.latency_s)
        done_s = until_s - max(late_s, self.latency_s)
        self.commands = [c for c in self.commands if c.stamp_s + c.hold_s > done_s]
        self.stamp_s = until_s

    def _excess(self) -> Array:
        """(n_joints,) rad beyond the joint limits."""
        return np.maximum(np.maximum(self.q - self.robot.upper_rad, self.robot.lower_rad - self.q), 0.0)

    def _judge(self) -> None:
        beyond = float((self._excess() - self.start_excess).max())
        self.result.limits_left += beyond > TOLERANCE
        self.result.beyond_rad = max(self.result.beyond_rad, beyond)
        distance_m = self.self_collision.distance_m(self.q)
        if self.clear_m == LIMITS.clearance_m:
            self.result.smallest_distance_mm = min(self.result.smallest_distance_mm, 1000 * distance_m)
        elif distance_m < self.clear_m - DISTANCE_TOLERANCE_M:
            self._fault(f"self-collision distance {1000 * distance_m:.4f} of {1000 * self.clear_m:.4f} mm")

    def _listen(self, reading: Array, step: PipelineStep) -> None:
        """Compare the step's report with the expected one."""
        self.visible_s = [t for t in self.visible_s if t >= self.stamp_s - 1.0]
        if np.abs(reading - self.assumed).max() > _VISIBLE_RAD:
            self.visible_s.append(self.stamp_s)
        if len(self.visible_s) > 1 and step.mismatch_rad <= _VISIBLE_RAD:
            self.result.unsaid.append(f"{self.name}, {self.stamp_s} s")
        if step.mismatch_rad > 0 and not self.said:
            self.said = True
            if self.visible_s:
                self.result.said_after_s.append(self.stamp_s - self.visible_s[0])
            else:
                self.result.said_in_vain.append(self.name)

"""A closed loop on kinematics: in place of images, the pipeline gets the true position and velocity of the object."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from learning.pps.memory import PPSMemory
from pps_vision.app.pipeline import Pipeline, PipelineStep
from pps_vision.robot.icub import home
from pps_vision.robot.skin import Skin
from pps_vision.types import Array, Status, StereoFrame, Track3D
from tracking.tracker import TrackerStep

DT = 0.05


def touched_by_all(skin: Skin) -> PPSMemory:
    """A memory as if whatever came near had touched the skin."""
    return PPSMemory.constant(skin)


def touched_on_course(skin: Skin) -> PPSMemory:
    """A memory as if whatever came on its way to a taxel had touched it, and nothing else."""
    empty = PPSMemory.empty(skin)
    counts = empty.counts.copy()
    low, high = empty.params.miss_range_m
    miss_m = np.linspace(low, high, empty.params.bins[2], endpoint=False)
    counts[:, :, :, miss_m < 0.02, 0] = 50
    counts[:, :, :, miss_m >= 0.02, 1] = 50
    return replace(empty, counts=counts)


Motion = Callable[[float], tuple[Array, Array] | None]


@dataclass
class KnownTrack:
    """In place of a tracker: position and velocity of the object at any time; None where it is not seen."""

    motion: Motion
    cov: Array = field(default_factory=lambda: 1e-6 * np.eye(12))

    def step(self, frame: StereoFrame) -> TrackerStep:
        state = self.motion(frame.stamp_s)
        track = Track3D.unknown(frame.stamp_s)
        if state is not None:
            mean = np.array([*state, np.zeros(3), np.zeros(3)])
            track = Track3D(frame.stamp_s, mean, self.cov, 0.02, 1e-8, Status.TRACKING)
        return TrackerStep(track, (), None, np.zeros((2, 3)))


@dataclass
class KnownTracks:
    """Several of them, numbered from 1; the one with the number `attended(t)` is attended."""

    motions: Sequence[Motion]
    attended: Callable[[float], int] = lambda t: 1

    def step(self, frame: StereoFrame) -> TrackerStep:
        steps = []
        for track_id, motion in enumerate(self.motions, start=1):
            step = KnownTrack(motion).step(frame)
            steps.append(replace(step, track=replace(step.track, track_id=track_id)))
        first = steps.pop(self.attended(frame.stamp_s) - 1)
        return replace(first, others=tuple(steps))


def frame_at(stamp_s: float, q_left: Array, q_right: Array | None = None) -> StereoFrame:
    """A frame with black images."""
    black = np.zeros((2, 2, 3), np.uint8)
    return StereoFrame(black, black, stamp_s, stamp_s, q_left, q_left if q_right is None else q_right)


def run(pipeline: Pipeline, seconds: float = 2.0, latency_s: float = 0.0) -> tuple[list[PipelineStep], Array]:
    """The steps of a robot that starts at home and obeys the commands, each for one period from `latency_s` after its
    stamp on, and its joints (T, n) before each."""
    q = home(pipeline.robot)
    steps = []
    joints = []
    late, part = divmod(latency_s / DT + 1e-9, 1)
    for k in range(int(seconds / DT)):
        steps.append(pipeline.step(frame_at(DT * k, q)))
        joints.append(q)
        for behind, share in ((int(late) + 1, part), (int(late), 1 - part)):
            if k >= behind:
                q = pipeline.robot.clamp(q + share * DT * steps[k - behind].command.dq_rad_s)
    return steps, np.array(joints)

"""What touches by seen objects teach about the robot's body: offsets of its encoders, positions of its taxels, and the
places at which a tool in its hand is touched."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from learning.pps.joint_offsets import TouchTrial, seen_from, verified_offsets
from learning.pps.taxel_positions import PartTouch, verified_positions
from learning.pps.tool import ToolTouch, touch_beyond
from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import Skin
from pps_vision.types import Array


@dataclass(frozen=True)
class LearnedBody:
    """A correction, each part applied only where held-out touches clearly confirm it."""

    offsets_rad: Array  # (n_joints,) to add to the encoders; 0: not confirmed
    positions_m: Array  # (n, 3) of the taxels in the frames of their parts; unchanged where not confirmed
    touches: int  # number of touches of the skin
    before_m: Array  # (k,) distances by which the held-out touches contradict the taxels
    after_m: Array  # (k,) the same with offsets from the other touches; as `before_m` if not confirmed
    moved_m: Array  # (n,) distances of the taxels from where they were taken to be
    beyond: list[ToolTouch]  # touches that are none of the skin's, neither before the correction nor after it

    @property
    def is_corrected(self) -> bool:
        """Whether anything was confirmed."""
        return bool(self.offsets_rad.any() or self.moved_m.any())

    def __str__(self) -> str:
        """The corrections, in a sentence."""
        said = f"body: {self.touches} touches"
        if not self.is_corrected:
            return f"{said} do not clearly show encoders or taxels to be off; left as they are"
        if self.offsets_rad.any():
            before, after = (1000 * np.median(values) for values in (self.before_m, self.after_m))
            most = np.rad2deg(np.abs(self.offsets_rad).max())
            said += f"; encoders corrected by up to {most:.1f}°: held-out touches seen {before:.0f} mm from where they"
            said += f" were felt, {after:.0f} corrected"
        if (moved := self.moved_m[self.moved_m > 0]).size:
            said += f"; {moved.size} taxels moved by {1000 * np.median(moved):.0f} mm"
        return said


def learned_body(robot: Robot, rig: StereoRig, skin: Skin, trials: Sequence[TouchTrial]) -> LearnedBody:
    """The body after touches, at the end of each trial by a known object."""
    as_is = np.zeros(robot.n_joints)
    is_far = [touch_beyond(robot, rig, skin, trial, as_is) is not None for trial in trials]
    far = list(compress(trials, is_far))
    trials = [trial for trial, beyond in zip(trials, is_far, strict=True) if not beyond]
    offsets = verified_offsets(robot, rig, skin, trials)
    parts = []
    for k, part in enumerate(skin.parts):
        touches = [
            PartTouch(seen_from(robot, rig, part.frame, trial, offsets.offsets_rad), float(trial.radius_m[-1]), touched)
            for trial in trials
            if (touched := trial.touched[skin.part_index == k]).any()
        ]
        parts.append(verified_positions(part, touches, stops=False))
    positions, before = (np.concatenate([part.positions_m for part in of]) for of in (parts, skin.parts))
    moved = np.linalg.norm(positions - before, axis=1)
    beyond = [touch for trial in far if (touch := touch_beyond(robot, rig, skin, trial, offsets.offsets_rad))]
    return LearnedBody(offsets.offsets_rad, positions, len(trials), offsets.before_m, offsets.after_m, moved, beyond)

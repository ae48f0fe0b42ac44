"""Films of a ball that circles before a swaying head, cast ray by ray, and what may befall them for a while."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from ball_scenes import Sphere, frame
from data import SEED

from pps_vision.experiments.films import disturbances as d
from pps_vision.experiments.films.recordings import Footage
from pps_vision.robot.icub import home, icub_rig, load_icub, set_gaze
from pps_vision.robot.silhouette import Silhouette
from pps_vision.types import Array, Image, StereoFrame

RED = (210.0, 45.0, 40.0)
RADIUS_M = 0.035
FPS = 20
EVERY = 2
ROBOT = load_icub()
RIG = icub_rig(ROBOT)


def swaying(t_s: float) -> Array:
    """A configuration whose neck turns by up to 5°/s."""
    yaw = 0.06 * np.sin(1.5 * t_s)
    pitch = -0.2 + 0.04 * np.sin(1.1 * t_s)
    return set_gaze(ROBOT, home(ROBOT), yaw=yaw, pitch=pitch, vergence=0.16)


_AHEAD = RIG.view(swaying(0.0)).left.T_root_camera


def circle(t_s: float) -> Array:
    """(3,) m: about 13 cm/s, 0.4 m ahead."""
    in_eye = [0.04 + 0.06 * np.sin(2.4 * t_s), 0.05 * np.cos(2.4 * t_s), 0.42 - 0.02 * t_s, 1.0]
    return (_AHEAD @ np.array(in_eye))[:3]


def film(
    seconds: float,
    pose: Callable[[float], Array] = swaying,
    position: Callable[[float], Array] = circle,
    others: Callable[[float], list[Sphere]] = lambda _: [],
    fps: int = FPS,
    noise: bool = True,
) -> Footage:
    """A red ball, and other spheres, with pixel noise of 2/255."""
    rng = np.random.default_rng(SEED) if noise else None
    stamps = np.arange(round(seconds * fps)) / fps
    frames = [frame(RIG, pose(t), [Sphere(position(t), RADIUS_M, RED), *others(t)], t, rng) for t in stamps]
    path = np.array([position(t) for t in stamps])
    visible = np.ones(len(frames), bool)
    boxes = ((None, None),) * len(frames)
    return Footage(tuple(frames), path, np.zeros_like(path), visible, boxes, RADIUS_M, RIG, Silhouette(ROBOT))


def during(usual: Footage, disturbed: Footage, from_s: float, to_s: float) -> Footage:
    """The usual film, with disturbed frames between two moments; a disturbed stamp may be some ms off its place."""
    picked = []
    for footage, slack_s, is_inside in ((usual, 0.0, False), (disturbed, 0.5 / FPS, True)):
        for stereo_frame, p in zip(footage.frames, footage.position, strict=True):
            if (from_s - 1e-6 <= stereo_frame.stamp_s + slack_s < to_s - 1e-6) == is_inside:
                picked.append((stereo_frame, p))
    picked.sort(key=lambda pair: pair[0].stamp_s)
    frames, position = zip(*picked, strict=True)
    return replace(usual, frames=frames, position=np.array(position), visible=np.ones(len(frames), bool))


def each(footage: Footage, change: Callable[[StereoFrame], StereoFrame]) -> Footage:
    """Every frame changed."""
    return replace(footage, frames=tuple(change(stereo_frame) for stereo_frame in footage.frames))


def blurred(fine: Footage, every: int, frames_open: int) -> Footage:
    """Each image the mean of `frames_open` successive fine ones around its stamp."""
    k = np.arange(every, len(fine.frames) - every, every)

    def mean(images: list[Image]) -> Image:
        return np.rint(np.mean(images, axis=0, dtype=np.float32)).astype(np.uint8)

    def blur(stereo_frame: StereoFrame, i: int) -> StereoFrame:
        shots = [fine.frames[i + offset - (frames_open - 1) // 2] for offset in range(frames_open)]
        return replace(stereo_frame, left=mean([s.left for s in shots]), right=mean([s.right for s in shots]))

    return d.each_frame(d.picked(fine, k), k.tolist(), blur)

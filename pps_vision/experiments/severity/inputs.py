"""Plausible recordings with one fault each, and sound ones: which are warned of, which give wrong numbers in silence.

Every film shows a ball before a wall, from its own rig: 6 to 100 cm baseline, cameras that converge, are rolled or
lie above each other, sharp or soft walls, two sizes of images.  A recording is wrong if the median error of the
track exceeds 5 mm and 1 % of the distance, or the speed is off by a tenth; it is silent if neither `info` nor `track`
warns.  The fault is visible if the true pixels of points on the wall, or of the ball, do not fit the cameras as given:
by more than a pixel (median), or most lie behind them; or if the rate is not the video's own.

Films of even seeds are videos whose files state their rate, the others images, of which only `--fps` tells it.
Nothing in the images tells the scale of the baseline, a focal length that is equally wrong in both cameras, or an error
that moves points along the epipolar lines only.

Endpoint, written before the run of seed 720 (5 films of each fault, 100 sound ones): wrong, silent and visible at most
2 %; wrong and silent at most 12 %; sound and warned of 0.  The thresholds were chosen on seeds 300–302, 400–407 and
710–714.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from pps_vision.app.info import info
from pps_vision.app.track import track
from pps_vision.app.track_files import diagnosis_of
from pps_vision.app.track_statistics import PathStatistics
from pps_vision.experiments.charts import PAGE_IN, panels
from pps_vision.experiments.films.caster import RayCaster, SensorChain
from pps_vision.experiments.films.scenes import FOCAL, Film, FilmScene
from pps_vision.experiments.tables import Table
from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.geometry.se3 import inverse, transform
from pps_vision.recordings.image_file import ImageFile
from pps_vision.recordings.recording import Recording, replaced_rate
from pps_vision.robot.icub import load_icub
from pps_vision.types import Array, Image

WRONG_M = 0.005
WRONG_SHARE = 0.01  # relative to the distance
WRONG_SPEED = 0.1
_SOUND = 1000  # first seed of the sound films
FEW_TRACKED = 0.2  # share of pairs: then nothing is claimed
VISIBLE_PX = 1.0
_WALL_POINTS = 400


@dataclass(frozen=True)
class Shot(ImageFile):
    """An image in memory."""

    pixels: Image = field(kw_only=True, repr=False)

    def load(self) -> Image:
        """Its pixels."""
        return self.pixels


class RigFilm(Film):
    """A film by cameras at any poses in the stage frame."""

    def __init__(self, scene: FilmScene, seed: int, poses: tuple[Array, Array]) -> None:
        super().__init__(scene, seed)
        self._poses = poses

    @cached_property
    def rig(self) -> StereoRig:
        """The cameras, in the left one's frame."""
        cameras = super().rig
        if self.scene.rig == "head":
            return cameras
        return StereoRig.fixed(cameras.left, cameras.right, inverse(self._poses[0]) @ self._poses[1])

    @cached_property
    def T_root_stage(self) -> Array:
        """The left camera's frame, or the iCub's root."""
        return super().T_root_stage if self.scene.rig == "head" else inverse(self._poses[0])

    def eye_poses(self, t_s: float) -> tuple[Array, Array]:
        """Return T_stage_left and T_stage_right (4, 4)."""
        if self.scene.rig == "head":
            return super().eye_poses(t_s)
        turn = transform(Rotation.from_rotvec(self._rig_rotation(self.scene.rig, t_s)).as_matrix())
        return turn @ self._poses[0], turn @ self._poses[1]

    def _casters(self) -> list[RayCaster]:
        scene = self.scene
        texel_m = scene.room_m / (FOCAL * scene.width)  # the walls look the same to both
        return [RayCaster(lens, scene.background, self.data, scene.room_m, texel_m) for lens in self._lenses]


@dataclass(frozen=True)
class Input:
    """Input of a user: images of both cameras, stamps, the cameras of the calibration, and joints (n, ·) of a head.

    `shown` (n, 2) are the film's frames of both images, and `seen` maps pixels (n, 2) of its left (0) or right (1)
    camera to the image's.
    """

    film: RigFilm
    images: tuple[tuple[Image, ...], tuple[Image, ...]]
    stamps_s: Array
    rig: StereoRig
    joints: Array | None
    shown: NDArray[np.int_]
    seen: Callable[[int, Array], Array] = lambda _, px: px
    order: tuple[int, int] = (0, 1)  # which camera's images are left and right

    @classmethod
    def of(cls, film: RigFilm) -> "Input":
        """A sound one."""
        frames = list(film)
        images = tuple(frame.left for frame in frames), tuple(frame.right for frame in frames)
        joints = None
        if film.scene.rig == "head":
            joints = np.array([frame.joints_left_rad for frame in frames])
            joints[:, _ARMS] = 0.7
        return cls(film, images, film.stamps_s, film.rig, joints, np.arange(len(frames)).repeat(2).reshape(-1, 2))

    def recording(self) -> Recording:
        """The opened recording."""
        pairs = []
        for k, t in enumerate(self.stamps_s.tolist()):
            joints = None if self.joints is None else self.joints[k]
            left, right = (Shot(Path(f"{k}.png"), t, joints, pixels=self.images[side][k]) for side in (0, 1))
            pairs.append((left, right))
        height, width = self.images[0][0].shape[:2]
        robot = None if self.joints is None else load_icub()
        warnings: tuple[str, ...] = ()
        if self.is_video:
            fps = float(1 / np.median(np.diff(self.stamps_s)))
            warnings = replaced_rate(f"--fps {fps:g}", fps, self.film.stamps_s.tolist())
        return Recording("made up", tuple(pairs), (width, height), [], robot, self.rig, warnings=warnings)

    @property
    def is_video(self) -> bool:
        """Whether the images come with a rate of their own."""
        return self.joints is None and self.film.seed % 2 == 0

    @property
    def is_visible(self) -> bool:
        """Whether true pixels of the wall, or of the ball, do not fit the cameras as given."""
        if all(left is right for left, right in zip(*self.images, strict=True)):
            return True
        if self.joints is not None:
            return self._turn_misfit_px() > VISIBLE_PX
        if self.is_video and self.recording().warnings:
            return True
        aside, parallax = self._misfits(*self._wall_px())
        pairs = [(self.film.truth[left], self.film.truth[right]) for left, right in self.shown.tolist()]
        pairs = [pair for pair in pairs if pair[0].visible_left and pair[1].visible_right]
        left, right = ([left.left_px for left, _ in pairs], [right.right_px for _, right in pairs])
        of_ball = self._misfits(np.array(left), np.array(right))[0]
        misfits_px = [float(np.median(np.abs(values))) for values in (aside, of_ball)]
        return bool(max(misfits_px) > VISIBLE_PX or np.mean(parallax < 0) > 0.5)

    def _wall_px(self) -> tuple[Array, Array]:
        """Pixels (n, 2) of points of the wall in both cameras."""
        film = self.film
        rng = np.random.default_rng(film.seed)
        room_m = film.scene.room_m
        points = rng.uniform(-1, 1, (_WALL_POINTS, 3)) * (1.25 * room_m, room_m, 0) + (0, 0, room_m)
        size = np.array([film.scene.width, film.scene.height])
        px = [lens.project(T, points) for lens, T in zip(film._lenses, film.eye_poses(0.0), strict=True)]
        inside = np.all([np.all((p > 0) & (p < size - 1), axis=1) for p in px], axis=0)
        return px[0][inside], px[1][inside]

    def _misfits(self, left_px: Array, right_px: Array) -> tuple[Array, Array]:
        """Epipolar distances (n,) px and parallaxes (n,) rad of pixels of the film's cameras, as the input has them."""
        px = (self.seen(0, left_px), self.seen(1, right_px))
        view = self.rig.view()
        left, right = view.left.rays(px[self.order[0]]), view.right.rays(px[self.order[1]])
        along = view.right.center / np.linalg.norm(view.right.center)
        normal = np.cross(along, left)
        aside = np.sum(normal * right, axis=1) / np.linalg.norm(normal, axis=1)
        return view.left.camera.fx * aside, np.arccos(right @ along) - np.arccos(left @ along)

    def _turn_misfit_px(self) -> float:
        """By how much a point of the left image is elsewhere in a later one than the joints say; its median."""
        if self.joints is None:
            return 0.0
        times = (0, len(self.stamps_s) // 2)
        true = [self.film.eye_poses(float(self.film.stamps_s[k]))[0][:3, :3] for k in times]
        given = [self.rig.view(self.joints[k]).left.T_root_camera[:3, :3] for k in times]
        camera = self.rig.left
        rays = camera.bearings(self._wall_px()[0])
        by_joints, by_images = (camera.project(rays @ R[0].T @ R[1]) for R in (given, true))
        return float(np.nanmedian(np.linalg.norm(by_joints - by_images, axis=1)))


def make_film(seed: int, head: bool = False) -> RigFilm:
    """A film by a rig of that seed."""
    rng = np.random.default_rng((seed, 7))
    width = 640 if rng.random() < 0.1 else 320
    baseline_m = float(np.exp(rng.uniform(np.log(0.06), 0.0)))
    distance_m = 0.068 * 8 if head else float(np.clip(baseline_m * rng.uniform(3, 6), 0.5, 3.0))
    soft = rng.random() < 0.25
    scene = FilmScene(
        width=width,
        height=3 * width // 4,
        fps=25.0,
        seconds=1.4,
        start="moving",
        radius_m=0.05 * distance_m,
        extent_m=0.15 * distance_m,
        speed_m_s=0.5 * distance_m,
        distance_m=distance_m,
        room_m=distance_m * rng.uniform(1.6, 3.0),
        rig="head" if head else "fixed",
        background=int(rng.integers(100)),
        sensor=SensorChain(defocus_px=width / 320 * rng.uniform(1.0, 4.0) if soft else 0.0),
    )
    is_vertical = rng.random() < 0.1
    rolled_deg = rng.choice([0.0, 90.0, rng.uniform(-10, 10)], p=[0.6, 0.1, 0.3])
    toe_rad = np.arctan(baseline_m / 2 / distance_m) if baseline_m > 0.3 or rng.random() < 0.4 else 0.0
    axis = np.array([0.0, 1, 0]) if is_vertical else np.array([1.0, 0, 0])
    turn_axis = np.array([-1.0, 0, 0]) if is_vertical else np.array([0.0, 1, 0])
    poses = []
    for sign in (-1, 1):
        toe = Rotation.from_rotvec(-sign * toe_rad * turn_axis)
        built = Rotation.from_rotvec(np.deg2rad(rng.normal(0, 1.0, 3)))  # no rig is built exactly
        roll = Rotation.from_rotvec([0, 0, np.deg2rad(rolled_deg)])
        poses.append(transform((toe * built * roll).as_matrix(), 0.5 * sign * baseline_m * axis))
    return RigFilm(scene, seed, (poses[0], poses[1]))


def _extrinsics(given: Input, change: Callable[[Array, Array], tuple[Array, Array]]) -> Input:
    """R and t of p_right = R p_left + t are changed."""
    view = given.rig.view()
    T_right_left = inverse(view.right.T_root_camera)
    R, t = change(T_right_left[:3, :3], T_right_left[:3, 3])
    return replace(given, rig=StereoRig.fixed(given.rig.left, given.rig.right, inverse(transform(R, t))))


def _cameras(given: Input, left: Callable[[Camera], Camera], right: Callable[[Camera], Camera] | None = None) -> Input:
    """The cameras are changed, both by one change or each by its own."""
    rig = given.rig
    return replace(given, rig=StereoRig(left(rig.left), (right or left)(rig.right), rig.eye_poses))


def _turned(axis: int, degrees: float) -> Callable[[Input, np.random.Generator], Input]:
    """The calibration's rotation is off."""

    def change(given: Input, rng: np.random.Generator) -> Input:
        error = Rotation.from_rotvec(np.deg2rad(degrees) * rng.choice([-1, 1]) * np.eye(3)[axis]).as_matrix()
        return _extrinsics(given, lambda R, t: (error @ R, t))

    return change


def _mapped(
    given: Input, sides: tuple[int, ...], image: Callable[[Image], Image], px: Callable[[Array, int, int], Array]
) -> Input:
    """Images of some sides are changed; `px` takes pixels, width and height."""
    height, width = given.images[0][0].shape[:2]
    left, right = (
        tuple(np.ascontiguousarray(image(shown)) if side in sides else shown for shown in given.images[side])
        for side in (0, 1)
    )

    def seen(side: int, pixels: Array) -> Array:
        return px(pixels, width, height) if side in sides else pixels

    return replace(given, images=(left, right), seen=seen)


def _mirrored(sides: tuple[int, ...]) -> Callable[[Input, np.random.Generator], Input]:
    return lambda given, _: _mapped(
        given, sides, np.fliplr, lambda p, w, h: np.array([w - 1, 0]) + p * np.array([-1, 1])
    )


def _upside_down(sides: tuple[int, ...]) -> Callable[[Input, np.random.Generator], Input]:
    return lambda given, _: _mapped(
        given, sides, lambda image: image[::-1, ::-1], lambda p, w, h: np.array([w - 1, h - 1]) - p
    )


def _shifted(rows: float) -> Callable[[Input, np.random.Generator], Input]:
    def change(given: Input, _: np.random.Generator) -> Input:
        n = round(rows * given.images[0][0].shape[0])
        return _mapped(given, (1,), lambda image: np.roll(image, n, axis=0), lambda p, w, h: p + np.array([0, n]))

    return change


def _late(frames: int) -> Callable[[Input, np.random.Generator], Input]:
    def change(given: Input, _: np.random.Generator) -> Input:
        left, right = given.images
        n = len(left) - frames
        shown = np.column_stack([np.arange(n) + frames, np.arange(n)])
        return replace(given, images=(left[frames:], right[:n]), stamps_s=given.stamps_s[frames:], shown=shown)

    return change


def _lossy(given: Input, rng: np.random.Generator) -> Input:
    """The right camera loses a tenth of its frames, and pairs are counted."""
    left, right = given.images
    kept = np.flatnonzero(rng.random(len(right)) > 0.1)
    n = len(kept)
    images = left[:n], tuple(right[int(k)] for k in kept)
    return replace(given, images=images, stamps_s=given.stamps_s[:n], shown=np.column_stack([np.arange(n), kept]))


def _exchanged(given: Input, _: np.random.Generator) -> Input:
    return replace(given, images=given.images[::-1], order=(1, 0))


def _joints(change: Callable[[Array], Array]) -> Callable[[Input, np.random.Generator], Input]:
    """The head's log is changed, not the arms'."""

    def changed(given: Input, _: np.random.Generator) -> Input:
        joints = np.array(given.joints)
        joints[:, _HEAD] = change(joints[:, _HEAD])
        return replace(given, joints=joints)

    return changed


def _resized(camera: Camera, scale: float) -> Camera:
    return replace(camera, fx=camera.fx * scale, fy=camera.fy * scale, cx=camera.cx * scale, cy=camera.cy * scale)


def _scaled(unit: float) -> Callable[[Input, np.random.Generator], Input]:
    return lambda given, _: _extrinsics(given, lambda R, t: (R, unit * t))


_ROBOT = load_icub()
_HEAD = _ROBOT.indices(_ROBOT.names.gaze_joints)
_ARMS = [k for k, name in enumerate(_ROBOT.joint_names) if "shoulder" in name or "elbow" in name]
_GL = np.diag([1.0, -1, -1])
Fault = Callable[[Input, np.random.Generator], Input]
FAULTS: Mapping[str, Fault] = {
    "R transposed": lambda i, _: _extrinsics(i, lambda R, t: (R.T, t)),
    "pose inverted": lambda i, _: _extrinsics(i, lambda R, t: (R.T, -R.T @ t)),
    "T with the other sign": lambda i, _: _extrinsics(i, lambda R, t: (R, -t)),
    "R lost": lambda i, _: _extrinsics(i, lambda R, t: (np.eye(3), t)),
    "axes of OpenGL": lambda i, _: _extrinsics(i, lambda R, t: (_GL @ R @ _GL, _GL @ t)),
    "T of the camera's place": lambda i, _: _extrinsics(i, lambda R, t: (R, -R.T @ t)),
    "cameras exchanged": lambda i, _: replace(i, rig=StereoRig(i.rig.right, i.rig.left, i.rig.eye_poses)),
    "distortion with the other sign": lambda i, _: _cameras(
        i, lambda c: replace(c, distortion=tuple(-k for k in c.distortion))
    ),
    "no distortion": lambda i, _: _cameras(i, lambda c: replace(c, distortion=(0.0,) * 5)),
    "pitch off 0.3°": _turned(0, 0.3),
    "yaw off 0.3°": _turned(1, 0.3),
    "roll off 0.3°": _turned(2, 0.3),
    "pitch off 1°": _turned(0, 1.0),
    "yaw off 2°": _turned(1, 2.0),
    "focal length off 10 %": lambda i, _: _cameras(i, lambda c: replace(c, fx=1.1 * c.fx, fy=1.1 * c.fy)),
    "K of another size": lambda i, _: _cameras(i, lambda c: _resized(c, 1.5)),
    "K of a cropped image": lambda i, _: _cameras(i, lambda c: replace(c, cx=c.cx + 0.125 * c.width)),
    "one focal length off 3 %": lambda i, _: _cameras(i, lambda c: replace(c, fx=1.03 * c.fx, fy=1.03 * c.fy), _same),
    "mm for m": _scaled(1000.0),
    "cm for m": _scaled(100.0),
    "squares a tenth too large": _scaled(1.1),
    "images exchanged": _exchanged,
    "both mirrored": _mirrored((0, 1)),
    "one mirrored": _mirrored((1,)),
    "both upside down": _upside_down((0, 1)),
    "one upside down": _upside_down((1,)),
    "right image 2 % lower": _shifted(0.02),
    "right 2 frames late": _late(2),
    "right 6 frames late": _late(6),
    "right loses frames": _lossy,
    "the same image twice": lambda i, _: replace(i, images=(i.images[0], i.images[0])),
    "rate twice as high": lambda i, _: replace(i, stamps_s=0.5 * i.stamps_s),
    "field of view 177°": lambda i, _: _cameras(i, lambda c: replace(c, fx=0.013 * c.width, fy=0.013 * c.width)),
}
"""Faults of fixed cameras."""
HEAD_FAULTS: Mapping[str, Fault] = {
    "head in radians": _joints(np.deg2rad),
    "head all 0": _joints(np.zeros_like),
    "head with the other sign": _joints(np.negative),
    "eyes exchanged": _exchanged,
}
"""Faults of a robot's recording."""


def _same(camera: Camera) -> Camera:
    return camera


def judge(given: Input, seed: int = 0) -> dict[str, Any]:
    """Return the warnings, whether the fault is visible, and whether the numbers are wrong, where nothing warned before
    tracking."""
    recording = given.recording()
    row: dict[str, Any] = {"visible": given.is_visible, "wrong": False}
    if warnings := info(recording).warnings:
        return row | {"warnings": [*warnings]}
    run = track(recording, objects=1, seed=seed)
    statistics = PathStatistics()
    steps = list(run)
    for pair in run.tracked_pairs(iter(steps)):
        statistics.add(pair.track, pair.residual_px)
    diagnosis = diagnosis_of(run, statistics)
    warnings = diagnosis.advice if diagnosis else ()
    known = [(k, step.track) for k, step in enumerate(steps) if step.track.is_known]
    row |= {"tracked": len(known) / len(steps), "warnings": [*warnings]}
    if row["tracked"] < FEW_TRACKED:
        return row
    pairs = [(step, given.film.truth[given.shown[k, 0]]) for k, step in known]
    error_m = np.median([np.linalg.norm(step.position - true.position) for step, true in pairs])
    distance_m = np.median([np.linalg.norm(true.position) for _, true in pairs])
    speed = np.median([np.linalg.norm(step.velocity) / np.linalg.norm(true.velocity) for step, true in pairs])
    wrong = error_m > max(WRONG_M, WRONG_SHARE * distance_m) or abs(speed - 1) > WRONG_SPEED
    return row | {"error_mm": 1000 * float(error_m), "wrong": bool(wrong)}


def run(study: Any) -> dict[str, Any]:
    """Return the rows of `judge` by fault, as "films"; "sound" without one."""
    rows: dict[str, list[dict[str, Any]]] = {"sound": []}
    for k in tqdm(range(study.n_sound), desc="sound", disable=None):
        rows["sound"].append(judge(Input.of(make_film(study.seed + _SOUND + k))))
    for k in tqdm(range(study.n_faulty), desc="faulty", disable=None):
        for head, faults in ((False, FAULTS), (True, HEAD_FAULTS)):
            sound = Input.of(make_film(study.seed + k, head))
            for name, fault in faults.items():
                row = judge(fault(sound, np.random.default_rng((study.seed + k, 8))))
                rows.setdefault(name, []).append(row)
    return {"films": rows}


def shares(numbers: Mapping[str, Any]) -> dict[str, tuple[int, int]]:
    """Return how many of how many faulty recordings are wrong in silence, how many of these show the fault, and how
    many sound ones are warned of."""
    films = numbers["films"]
    faulty = [row for name, rows in films.items() if name != "sound" for row in rows]
    silent = [row for row in faulty if row["wrong"] and not row["warnings"]]
    visible = [row for row in silent if row["visible"]]
    warned = [row for row in films["sound"] if row["warnings"]]
    return {
        "wrong, silent and visible": (len(visible), len(faulty)),
        "wrong and silent": (len(silent), len(faulty)),
        "sound and warned of": (len(warned), len(films["sound"])),
    }


def table(numbers: dict[str, Any]) -> Table:
    """Tabulate the shares."""
    rows = [[name, f"{n} of {of}", f"{100 * n / max(of, 1):.1f}"] for name, (n, of) in shares(numbers).items()]
    return Table(["recordings", "number", "%"], rows)


def chart(numbers: dict[str, Any]) -> Figure:
    """Draw by fault how many recordings are warned of, right in silence, and wrong in silence."""
    films = numbers["films"]
    names = [*films]
    figure, (axis,) = panels(1, width=PAGE_IN, height=1.0 + 0.16 * len(names))
    left = np.zeros(len(names))
    kinds: dict[str, Callable[[dict[str, Any]], bool]] = {
        "warned of": lambda row: bool(row["warnings"]),
        "silent, right or not tracked": lambda row: not row["warnings"] and not row["wrong"],
        "silent and wrong, not visible": lambda row: not row["warnings"] and row["wrong"] and not row["visible"],
        "silent and wrong, visible": lambda row: not row["warnings"] and row["wrong"] and row["visible"],
    }
    for (kind, holds), color in zip(kinds.items(), ("tab:green", "0.85", "tab:orange", "tab:red"), strict=True):
        percent = np.array([100 * np.mean([holds(row) for row in films[name]]) for name in names])
        axis.barh(range(len(names)), percent, left=left, color=color, label=kind)
        left += percent
    axis.set_yticks(range(len(names)), names, fontsize=6)
    axis.set_ylim(len(names) - 0.5, -0.5)
    axis.set_xlabel("recordings (%)", fontsize=8)
    axis.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, fontsize=7)
    return figure

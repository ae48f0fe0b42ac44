"""What a filter gets and what it should have made of it: rendered objects, and recorded table-tennis flights."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from tqdm import tqdm

from pps_vision.app.render import Render
from pps_vision.experiments.rendered import Rendered, rendered
from pps_vision.experiments.study import SceneSource
from pps_vision.geometry.camera import Camera, StereoView, View
from pps_vision.geometry.se3 import inverse, rotation_to, transform
from pps_vision.geometry.triangulation import triangulate
from pps_vision.types import Array, Mask, Status, Truth
from rendering.names import MotionName, StimulusName
from tracking.kalman import KalmanParams
from tracking.tracker import Tracker, TrackerParams, TrackerStep

MOTIONS: tuple[MotionName, ...] = ("approach", "linear", "circle", "figure8", "jerk")
TRACKED: tuple[tuple[StimulusName, str], ...] = (("ball", "generic"), ("marker", "marker"))
SETTLED = 10  # measurements before a filter is judged
_JUMP_M_S = 0.04  # between two frames the velocity of what a hand moves does not change as much
_LOOK_BACK_S = 0.5  # before a touch, where its time must be known
_PIXEL_STD = 2.0  # of the noisy tt3d projections, found between the two cameras' rays


@dataclass(frozen=True)
class Sequence:
    """Measured `positions` (n, 3) m with `covs` (n, 3, 3) m² at `stamps_s` (n,), the true `path` and `velocity`
    (n, 3), how far from the eyes it begins, and how much of the error is new every frame.

    `jumped` (n,): within two frames after the velocity jumped.  `touched` (3,): the point that is touched, if any;
    `ttc_s` (n,) the true time until then, NaN where there is none to come.  Of rendered objects also the true
    `radius_m` and the tracker's `steps` (n).
    """

    name: str
    stamps_s: Array
    positions: Array
    covs: Array
    path: Array
    velocity: Array
    distance_m: float
    jumped: Mask
    touched: Array
    ttc_s: Array
    white_share: float = KalmanParams().white_share
    radius_m: float = 0.0
    steps: tuple[TrackerStep, ...] = ()

    @property
    def late(self) -> Mask:
        """(n,) the last half second before a touch, but for the very last frame, where there is no way left."""
        return (self.ttc_s <= _LOOK_BACK_S) & (self.ttc_s > 0.02)


def rendered_sequences(
    n: int, seconds: float, noise: float, seed: int, source: SceneSource = "rendered"
) -> list[Sequence]:
    """Balls (generic tracker) and markers (marker tracker), `n` of each on every motion, the head moving."""
    places = [(s, mode, motion, k) for k in range(n) for s, mode in TRACKED for motion in MOTIONS]
    found = []
    for s, mode, motion, k in tqdm(places, desc="render and track", unit="recording", disable=None):
        what = Render(s, motion, Path(), seconds=seconds, noise=noise, seed=seed + k)
        found.append(tracked(f"{s} {motion}", rendered(what, source), mode, seed + k))
    return found


def approach_sequences(
    n: int, speeds_m_s: tuple[float, ...], noise: float, seed: int, source: SceneSource = "rendered"
) -> list[Sequence]:
    """Balls and markers that approach the skin at given speeds, `n` of each, until they touch."""
    places = [(s, mode, speed, k) for k in range(n) for s, mode in TRACKED for speed in speeds_m_s]
    found = []
    for s, mode, speed, k in tqdm(places, desc="render approaches", unit="recording", disable=None):
        what = Render(s, "approach", Path(), seconds=0.31 / speed + 0.2, noise=noise, speed=speed, seed=seed + k)
        found.append(tracked(f"{s} {100 * speed:g} cm/s", rendered(what, source), mode, seed + k))
    return found


def tracked(name: str, film: Rendered, mode: str, seed: int) -> Sequence:
    """What our tracker, `mode` generic or marker, measured in a rendered recording."""
    params = TrackerParams(mode="marker" if mode == "marker" else "generic")
    tracker = Tracker(params, film.rig, np.random.default_rng(seed))
    steps = [tracker.step(frame) for frame in film.frames]
    known = [k for k, step in enumerate(steps) if step.observation is not None]
    seen = [one for one in (steps[k].observation for k in known) if one is not None]
    truth = [film.truth[k] for k in known]
    velocity = np.array([row.velocity for row in truth])
    touched, ttc = _touch(film.truth)
    return Sequence(
        name=name,
        stamps_s=np.array([one.stamp_s for one in seen]),
        positions=np.array([one.p_root for one in seen]),
        covs=np.array([one.cov_root for one in seen]),
        path=np.array([row.position for row in truth]),
        velocity=velocity,
        distance_m=float(np.linalg.norm(seen[0].p_root - steps[known[0]].head)),
        jumped=_jumped(velocity),
        touched=touched,
        ttc_s=ttc[known],
        radius_m=truth[0].radius_m,
        steps=tuple(steps[k] for k in known),
    )


def _jumped(velocity: Array) -> Mask:
    jump = np.concatenate([[False], np.linalg.norm(np.diff(velocity, axis=0), axis=1) > _JUMP_M_S])
    return jump | np.concatenate([[False], jump[:-1]])


def _touch(truth: tuple[Truth, ...]) -> tuple[Array, Array]:
    """The point (3,) that the surface of what comes straight first touches, and the time (n,) until then."""
    speed = np.array([np.linalg.norm(row.velocity) for row in truth])
    ttc = np.full(len(truth), np.nan)
    rests = np.flatnonzero(speed < 1e-9)
    if not len(rests) or rests[0] == 0 or np.ptp(speed[: rests[0]]) > 1e-6:
        return np.full(3, np.nan), ttc
    first = int(rests[0])
    way = truth[first].position - truth[0].position
    for k in range(first):
        ttc[k] = np.linalg.norm(truth[first].position - truth[k].position) / speed[k]
    touched: Array = truth[first].position + truth[first].radius_m * way / np.linalg.norm(way)
    return touched, ttc


def tracking_steps(sequence: Sequence) -> Iterator[tuple[int, TrackerStep]]:
    """Steps on which the tracker, settled, says it tracks."""
    for k, step in enumerate(sequence.steps):
        if k >= SETTLED and step.track.status == Status.TRACKING:
            yield k, step


def simulated_sequences(n: int, fps: float, seed: int) -> list[Sequence]:
    """Fast motions without images, `n` of each: measured at `fps` with 0.2 mm, of which the filter's share is new."""
    rng, std = np.random.default_rng(seed), 2e-4
    stamps, h = np.arange(0.0, 4.0, 1 / fps), 1e-5
    share = KalmanParams().white_share
    found = []
    for name, position in [motion for _ in range(n) for motion in _fast_motions(rng)]:
        path, before, after = (np.array([position(t + shift) for t in stamps]) for shift in (0.0, -h, h))
        noise = np.sqrt(share) * rng.standard_normal(path.shape) + np.sqrt(1 - share) * rng.standard_normal(3)
        found.append(
            Sequence(
                name=name,
                stamps_s=stamps,
                positions=path + std * noise,
                covs=np.tile(std**2 * np.eye(3), (len(stamps), 1, 1)),
                path=path,
                velocity=(after - before) / (2 * h),
                distance_m=0.4,
                jumped=np.zeros(len(stamps), bool),
                touched=np.full(3, np.nan),
                ttc_s=np.full(len(stamps), np.nan),
            )
        )
    return found


def _fast_motions(rng: np.random.Generator) -> list[tuple[str, Callable[[float], Array]]]:
    """Position (3,) m of the time: two periodic motions, and minimum-jerk reaches to and fro with pauses of 0.2 s."""
    phase, plane = rng.uniform(0, 2 * np.pi), rotation_to(rng.standard_normal(3))

    def reach(t: float) -> Array:
        number, since = divmod(t + phase, 1.0)
        tau = min(since / 0.8, 1.0)
        way = tau**3 * (10 - 15 * tau + 6 * tau**2)
        return 0.3 * (way if number % 2 == 0 else 1 - way) * plane[:, 0]

    return [
        ("5 cm to and fro, 1 Hz", lambda t: 0.05 * np.sin(2 * np.pi * t + phase) * plane[:, 0]),
        ("circle of 6 cm, 1 Hz", lambda t: 0.06 * plane[:, :2] @ [np.cos(2 * np.pi * t), np.sin(2 * np.pi * t)]),
        ("reaches of 30 cm in 0.8 s", reach),
    ]


def flights(folder: Path) -> list[Sequence]:
    """Every noisy flight of a tt3d folder, triangulated from its two cameras: the truth is only compared with."""
    view = StereoView(_camera(folder / "side.yaml"), _camera(folder / "oblique.yaml"))
    return [_flight(file, folder / "oblique" / file.name, view) for file in sorted((folder / "side").glob("*.csv"))]


def _camera(file: Path) -> View:
    """Of lines `name: number or [numbers]`: rvec, tvec (world to camera), f, w, h; the principal point amid."""
    of = {name: json.loads(value) for name, value in (s.split(":", 1) for s in file.read_text().splitlines() if s)}
    T_camera_world = transform(cv2.Rodrigues(np.array(of["rvec"]))[0], of["tvec"])
    camera = Camera(of["w"], of["h"], of["f"], of["f"], of["w"] / 2, of["h"] / 2)
    return View(camera, inverse(T_camera_world))


def _flight(side: Path, oblique: Path, view: StereoView) -> Sequence:
    one, other = (np.genfromtxt(file, delimiter=",", names=True) for file in (side, oblique))
    noise = _PIXEL_STD**2 * np.eye(2)
    pixels = zip(np.stack([one["u"], one["v"]], 1), np.stack([other["u"], other["v"]], 1), strict=True)
    points = [triangulate(view, left, right, noise, noise) for left, right in pixels]
    kept = [k for k, point in enumerate(points) if point is not None]
    found = [point for point in points if point is not None]
    truth = np.stack([one["X"], one["Y"], one["Z"]], axis=1)[kept]
    positions = np.array([point.p_root for point in found])
    unknown = np.full(len(kept), np.nan)
    return Sequence(
        name=side.stem,
        stamps_s=one["Timestamp"][kept],
        positions=positions,
        covs=np.array([point.cov_root for point in found]),
        path=truth,
        velocity=np.full_like(truth, np.nan),
        distance_m=float(np.linalg.norm(positions[0] - 0.5 * (view.left.center + view.right.center))),
        jumped=np.zeros(len(kept), bool),
        touched=np.full(3, np.nan),
        ttc_s=unknown,
        white_share=1.0,
    )

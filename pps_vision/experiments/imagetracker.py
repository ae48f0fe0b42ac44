"""Following an object in one eye: our blob and particles, and OpenCV's trackers, on the same frames."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from pps_vision.app.render import Render
from pps_vision.experiments.chart import Variant, legend, panels, speed_against_error, timed
from pps_vision.experiments.peers import BoxPx, ImagePeer, ImagePeerName, image_peer, middle
from pps_vision.experiments.real import intersection_over_union
from pps_vision.experiments.rendered import rendered
from pps_vision.experiments.study import DATA, Study
from pps_vision.recordings.images import open_frames
from pps_vision.types import Image
from rendering.names import MotionName, StimulusName
from tracking.image_tracker import BoxTracker, ImageTrackerParams, assumed_optics
from tracking.marker import MarkerParams, find_markers
from tracking.outline import Optics
from tracking.particle_filter import ParticleParams

COUNTS = (50, 100, 200, 500, 1000, 2000)
MOTIONS: tuple[MotionName, ...] = ("circle", "figure8", "linear", "jerk")
_HUES_DEG = {"ball": 0.0, "marker": 120.0}
_FAST_M_S = 0.6
_SEEDS_FAST = 3  # of the particles, for whom luck decides there
_BLOB = "blob of known hue"
_DEFAULT = f"{ParticleParams().count} particles"


@dataclass(frozen=True)
class ImageTracker(Study):
    """Blob, particles and OpenCV's trackers in one eye, the first box given: time, overlap and centre error.

    Rendered balls and markers, slow and watched (5–15 cm/s, eyes that follow while the head sways) and fast
    (60 cm/s, eyes that do not follow: up to twice the object's size a frame); and the real ball vot_ball1.
    """

    n: int = 6
    """Rendered recordings, slow and fast each; balls and markers in turn."""
    seconds: float = 2.5
    """Length of each."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    data: Path = DATA
    """Folder that holds vot_ball1 (default: PPS_VISION_DATA, else ../shared/data)."""
    seed: int = 0
    """Seed of the motions, the noise and the particles."""

    def run(self) -> dict[str, object]:
        """By set of frames and by variant: ms a frame, mean IoU, centre error, share of frames with the object."""
        if self.n < 1:
            raise ValueError(f"bench imagetracker: --n {self.n}; expected at least 1")
        place = self.data / "vot_ball1"
        real: dict[str, object] | str = f"skipped: no {place}"
        if place.exists():
            real = compare([real_ball(place)], (self.seed,))
        return {
            "slow": compare(self._sequences(fast=False), (self.seed,)),
            "fast": compare(self._sequences(fast=True), range(self.seed, self.seed + _SEEDS_FAST)),
            "vot_ball1": real,
        }

    def _sequences(self, fast: bool) -> Iterator["Sequence"]:
        for k in tqdm(range(self.n), desc="fast" if fast else "slow", unit="recording", disable=None):
            stimulus: StimulusName = "marker" if k % 2 else "ball"
            motion = MOTIONS[k // 2 % len(MOTIONS)]
            slow = Render(stimulus, motion, Path(), seconds=self.seconds, noise=self.noise, seed=self.seed + k)
            film = rendered(replace(slow, speed=_FAST_M_S, head="sway") if fast else slow)
            yield Sequence(
                tuple(frame.left for frame in film.frames), tuple(left for left, _ in film.boxes), _HUES_DEG[stimulus]
            )

    def chart(self, numbers: Mapping[str, Any]) -> dict[str, Figure]:
        """Overlap lost: against time, beside the peers; against the number of particles."""
        return {"peers": _peers_chart(numbers), "particles": _particles_chart(numbers)}


def _shown(numbers: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    """What there are numbers of, with its title."""
    titles = {"slow": "rendered, eyes follow", "fast": "rendered, 0.6 m/s, head sways", "vot_ball1": "vot_ball1"}
    return [(title, numbers[name]) for name, title in titles.items() if isinstance(numbers[name], dict)]


def _peers_chart(numbers: Mapping[str, Any]) -> Figure:
    peers = get_args(ImagePeerName)
    shown = _shown(numbers)
    figure, axes = panels(len(shown))
    for axis, (title, measured) in zip(axes, shown, strict=True):
        names = [name for name in measured if name in (*peers, _BLOB, _DEFAULT)]
        variants = [Variant.of(name, measured[name], name not in peers, name == _DEFAULT) for name in names]
        speed_against_error(axis, variants, "frame", "1 − mean IoU")
        axis.margins(0.12)
        axis.set_title(title, fontsize=9)
    legend(axes[0])
    return figure


def _particles_chart(numbers: Mapping[str, Any]) -> Figure:
    figure, (error_axis, time_axis) = panels(2)
    for k, (title, measured) in enumerate(_shown(numbers)):
        for axis, key in ((error_axis, "error"), (time_axis, "median_ms")):
            axis.plot(COUNTS, [measured[str(n)][key] for n in COUNTS], "o-", color=f"C{k}", label=title)
    for axis, label in ((error_axis, "1 − mean IoU"), (time_axis, "time (ms per frame)")):
        axis.set_xscale("log")
        axis.set_xticks(COUNTS, [str(n) for n in COUNTS])
        axis.set_ylim(bottom=0)
        axis.set_xlabel("particles")
        axis.set_ylabel(label)
        axis.grid(alpha=0.25)
    error_axis.legend(fontsize=7)
    return figure


@dataclass(frozen=True)
class Sequence:
    """`images` (n) of one eye, the true `boxes` (n), None where the object is not in view, and its hue."""

    images: tuple[Image, ...]
    boxes: tuple[BoxPx | None, ...]
    hue_deg: float


def real_ball(folder: Path) -> Sequence:
    """VOT's ball1, boxes upright around the annotated polygons; the ball is red."""
    polygons = np.loadtxt(folder / "groundtruth.txt", delimiter=",").reshape(-1, 4, 2)
    low, high = polygons.min(axis=1), polygons.max(axis=1)
    boxes = [(float(x), float(y), float(w), float(h)) for x, y, w, h in np.hstack([low, high - low])]
    return Sequence(tuple(image for _, image in open_frames(folder / "frames")), tuple(boxes), 0.0)


class Particles:
    """Our particle filter as a peer of the others."""

    def __init__(self, params: ParticleParams, seed: int) -> None:
        self._tracker = BoxTracker(ImageTrackerParams(particles=params), np.random.default_rng(seed))

    def start(self, image: Image, box: BoxPx) -> None:
        """Learn what is in the box."""
        self._tracker.start(image, box)

    def step(self, image: Image) -> BoxPx | None:
        """None where it was not seen."""
        seen = self._tracker.step(image)
        return seen.box_px if seen.score > 0 else None


class HueBlob:
    """Our marker's blob: the hue told, the nearest blob around the last place, anywhere when there is none."""

    def __init__(self, hue_deg: float) -> None:
        self._params = MarkerParams(hue_deg=hue_deg)
        self._optics: Optics | None = None
        self._last: BoxPx | None = None

    def start(self, image: Image, box: BoxPx) -> None:
        """Learn the place."""
        self._optics = assumed_optics(image.shape[1], image.shape[0])
        self._last = box

    def step(self, image: Image) -> BoxPx | None:
        """The box of the disc that has the blob's area."""
        if self._optics is None:
            raise ValueError("step before start; the tracker needs a first image and box")
        near = None
        if self._last is not None:
            x, y = middle(self._last)
            near = float(x), float(y), max(self._last[2:]) + 3
        found = find_markers(self._params, image, self._optics, near)
        self._last = None
        if found:
            shape = found[0]
            side = 2 * float(np.sqrt(shape.area_px / np.pi))
            x, y = shape.center_px - (side - 1) / 2
            self._last = float(x), float(y), side, side
        return self._last


def variants(hue_deg: float, seed: int) -> dict[str, Callable[[], ImagePeer]]:
    """Everything that is compared, by name."""

    def particles(params: ParticleParams) -> Callable[[], ImagePeer]:
        return lambda: Particles(params, seed)

    def peer(name: ImagePeerName) -> Callable[[], ImagePeer]:
        return lambda: image_peer(name)

    return {
        _BLOB: lambda: HueBlob(hue_deg),
        _DEFAULT: particles(ParticleParams()),
        **{str(n): particles(ParticleParams(count=n)) for n in COUNTS},
        **{name: peer(name) for name in get_args(ImagePeerName)},
    }


@dataclass
class _Log:
    """What one variant did: ms, IoU (0 where lost) and centre error (NaN where lost) of every frame."""

    ms: list[float] = field(default_factory=list)
    iou: list[float] = field(default_factory=list)
    center_px: list[float] = field(default_factory=list)

    def add(self, ms: float, found: BoxPx | None, true: BoxPx | None) -> None:
        self.ms.append(ms)
        if true is None:
            return
        overlap = 0.0 if found is None else intersection_over_union(np.array([found]), np.array([true]))[0]
        self.iou.append(float(overlap))
        off = np.nan if found is None else float(np.linalg.norm(middle(found) - middle(true)))
        self.center_px.append(off if overlap > 0 else np.nan)

    def summary(self, name: str) -> dict[str, object]:
        """The error is what of the overlap is missing."""
        held = np.isfinite(self.center_px)
        return {
            **Variant(name, np.array(self.ms), 1 - float(np.mean(self.iou))).summary(),
            "mean_iou": float(np.mean(self.iou)),
            "held_share": float(np.mean(held)),
            "center_px_median_where_held": float(np.median(np.array(self.center_px)[held])) if held.any() else None,
        }


def compare(sequences: Iterable[Sequence], seeds: Iterable[int]) -> dict[str, object]:
    """All variants on every frame in turn; those that draw random numbers once a seed."""
    logs: dict[str, _Log] = {}
    for sequence in sequences:
        first = sequence.boxes[0]
        if first is None:
            raise ValueError("the object is not in view of the first frame; expected a box to start with")
        trackers = [
            (name, make())
            for k, seed in enumerate(seeds)
            for name, make in variants(sequence.hue_deg, seed).items()
            if k == 0 or name not in (_BLOB, *get_args(ImagePeerName))
        ]
        for _, tracker in trackers:
            tracker.start(sequence.images[0], first)
        for image, true in zip(sequence.images[1:], sequence.boxes[1:], strict=True):
            for name, tracker in trackers:
                found, ms = timed(lambda t=tracker, i=image: t.step(i))  # type: ignore[misc]
                logs.setdefault(name, _Log()).add(ms, found, true)
    return {name: log.summary(name) for name, log in logs.items()}

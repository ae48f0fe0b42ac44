"""One scene before many motion triggers at once: what each saw, how long it took, and how soon it was right."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from time import thread_time

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.experiments.chart import timed
from pps_vision.experiments.motion_peers import FLOWS, PEERS, BoxPx, dis, endpoint_error, grey_of
from pps_vision.experiments.trigger_scenes import AFTER, STARTS, Glimpse, Scene
from pps_vision.geometry.camera import Camera
from pps_vision.robot.silhouette import Silhouette
from pps_vision.types import Mask
from tracking.motion_trigger import MotionTrigger, TriggerParams

Watcher = Callable[[Glimpse], list[BoxPx]]
MISSED = AFTER + 1.0  # frames that count for what was not found at all
_NEAR_PX = 4.0  # how far beside the ball a region may lie
_OWN_SHARE = 0.3  # of a peer's region on the robot itself, above which it is no alarm
_FLO_MAGIC = b"PIEH"


def ours(params: TriggerParams, camera: Camera, silhouette: Silhouette | None) -> Watcher:
    """Our trigger; what it takes to know where the robot is belongs to its time (None: nowhere)."""
    trigger = MotionTrigger(params, camera)

    def look(seen: Glimpse) -> list[BoxPx]:
        own = partial(silhouette, seen.joints_rad, seen.view) if silhouette else None
        found = trigger.step(seen.image, seen.view, seen.stamp_s, own)
        return [region.box_px for region in found]

    return look


def peer(name: str, camera: Camera, level: float) -> Watcher:
    """A peer at one level."""
    method = PEERS[name].make(camera, level)
    return lambda seen: method.step(seen.image, seen.view)


def watch(watchers: Mapping[str, Watcher], scene: Scene) -> dict[str, tuple[list[list[BoxPx]], list[float]]]:
    """Regions and milliseconds of processor time of each image, by variant.

    One image goes to all, each time in another order (what comes after a method that fills the cache is slower),
    before the next comes.  Nobody is blamed for the robot's own body.
    """
    result: dict[str, tuple[list[list[BoxPx]], list[float]]] = {name: ([], []) for name in watchers}
    names = list(watchers)
    for k, seen in enumerate(scene.glimpses):
        for name in [names[i] for i in np.random.default_rng(k).permutation(len(names))]:
            boxes, ms = _processor_time(partial(watchers[name], seen))
            result[name][0].append([box for box in boxes if not _is_own(box, seen.own)])
            result[name][1].append(ms)
    return result


def _processor_time(run: Callable[[], list[BoxPx]]) -> tuple[list[BoxPx], float]:
    start = thread_time()
    boxes = run()
    return boxes, 1000 * (thread_time() - start)


def references() -> dict[str, Watcher]:
    """Flow alone, as a measure of time: DIS ultrafast, and Lucas–Kanade of 100 points; they report nothing."""
    whole, sparse = dis(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST), np.zeros((100, 1, 2), np.float32)
    last: dict[str, NDArray[np.uint8]] = {}

    def dense(seen: Glimpse) -> list[BoxPx]:
        now = grey_of(seen.image)
        whole(now, last.get("dense", now))
        last["dense"] = now
        return []

    def points(seen: Glimpse) -> list[BoxPx]:
        now = grey_of(seen.image)
        height, width = now.shape
        x, y = np.meshgrid(np.linspace(0.1, 0.9, 10) * width, np.linspace(0.1, 0.9, 10) * height)
        sparse[:, 0, 0], sparse[:, 0, 1] = x.ravel(), y.ravel()
        cv2.calcOpticalFlowPyrLK(last.get("points", now), now, sparse, np.empty(0))
        last["points"] = now
        return []

    return {"DIS ultrafast": dense, "LK, 100 points": points}


def best_level(name: str, calm: Scene) -> float:
    """The lowest level without a false alarm in a scene where nothing moves; the highest where there is none."""
    levels = PEERS[name].levels
    low, high = 0, len(levels) - 1
    while low < high:  # the higher, the calmer
        middle = (low + high) // 2
        low, high = (low, middle) if _is_calm(peer(name, calm.camera, levels[middle]), calm) else (middle + 1, high)
    return levels[low]


def _is_calm(look: Watcher, calm: Scene) -> bool:
    alarms = ([box for box in look(seen) if not _is_own(box, seen.own)] for seen in calm.glimpses)
    return not any(found for k, found in enumerate(alarms) if k >= STARTS)


def delay(boxes: list[list[BoxPx]], scene: Scene) -> float:
    """Frames until a region meets the way that the ball has come, counted from the first that shows it elsewhere."""
    for k in range(STARTS, len(boxes)):
        way = scene.center_px[STARTS - 1 : k + 1]
        low, high = way.min(axis=0) - scene.radius_px - _NEAR_PX, way.max(axis=0) + scene.radius_px + _NEAR_PX
        if any(x < high[0] and y < high[1] and x + w > low[0] and y + h > low[1] for x, y, w, h in boxes[k]):
            return float(k - STARTS + 1)
    return MISSED


def _is_own(box: BoxPx, own: Mask) -> bool:
    x, y, w, h = box
    return bool(own[y : y + h, x : x + w].mean() > _OWN_SHARE)


def flow_errors(folder: Path, runs: int = 5) -> dict[str, dict[str, float]] | str:
    """End-point error on Middlebury's RubberWhale, frame 10 to 11, and time, of every peer that is a flow."""
    truth_file = folder / "flow10.flo"
    if not truth_file.exists():
        return f"skipped: no {folder}"
    first, second = (_read_grey(folder / f"frame{k}.png") for k in (10, 11))
    truth = read_flow(truth_file)
    times: dict[str, list[float]] = {name: [] for name in FLOWS}
    errors: dict[str, float] = {}
    methods = {name: make() for name, make in FLOWS.items()}
    for _ in range(runs):
        for name, flow in methods.items():
            found, ms = timed(partial(flow, first, second))
            times[name].append(ms)
            errors[name] = endpoint_error(found, truth)
    return {name: {"endpoint_px": errors[name], **quartiles(times[name])} for name in FLOWS}


def quartiles(ms: list[float]) -> dict[str, float]:
    """Median and quartiles."""
    return dict(zip(("q25_ms", "median_ms", "q75_ms"), map(float, np.percentile(ms, (25, 50, 75))), strict=True))


def read_flow(file: Path) -> NDArray[np.float32]:
    """(h, w, 2) px of a Middlebury .flo file; 1e9 and more where it is not known.  ValueError for anything else."""
    data = file.read_bytes()
    if data[:4] != _FLO_MAGIC:
        raise ValueError(f"{file}: starts with {data[:4]!r}; expected a Middlebury flow, {_FLO_MAGIC!r}")
    width, height = np.frombuffer(data, "<i4", 2, 4)
    if len(data) != 12 + 8 * int(width) * int(height):
        raise ValueError(
            f"{file}: {len(data)} bytes; expected {12 + 8 * int(width) * int(height)} for {width}×{height}"
        )
    return np.frombuffer(data, "<f4", offset=12).reshape(height, width, 2)


def _read_grey(file: Path) -> NDArray[np.uint8]:
    image = cv2.imread(str(file))
    if image is None:
        raise ValueError(f"{file}: no image; expected one of RubberWhale's frames")
    return grey_of(np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8))

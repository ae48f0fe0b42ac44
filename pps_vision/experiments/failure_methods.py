"""Who is put on the failure map, and how a run is judged."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pps_vision.experiments.footage import EYES_M, Footage
from pps_vision.experiments.peers import BoxPx, ImagePeerName, image_peer
from pps_vision.experiments.stereo_peers import FilteredPeer, meet
from pps_vision.geometry.camera import StereoRig
from pps_vision.types import Array, Image, StereoFrame, Track3D
from tracking.marker import MarkerParams
from tracking.tracker import Tracker, TrackerParams

OURS: dict[str, TrackerParams] = {
    "ours": TrackerParams(),
    "ours, marker": TrackerParams(mode="marker", marker=MarkerParams(hue_deg=0.0)),
}
PEERS: dict[str, ImagePeerName] = {"two CSRT": "CSRT", "two KCF": "KCF", "two CamShift": "CamShift"}
NEAR = 1 / 6  # of its distance: no more is asked than that it is still the same thing
SETTLE_S = 0.5  # so long a tracker is given to find what has come into sight
_REMEMBERED = 24  # image sequences
_Boxes = list[BoxPx | None]


@dataclass(frozen=True)
class Score:
    """Of the frames that count: the share in which the track is near the object (within a sixth of its distance
    from the eyes, 7 cm at 0.42 m), and the RMS error (m, NaN if never known); of all frames from the first such
    on, the share in which it is not, and farther off than thrice its own standard deviation."""

    success: float
    rms_m: float
    wrong: float


def judge(footage: Footage, tracks: list[Track3D], settle_s: float = SETTLE_S) -> Score:
    """The score of one run.  Of two objects the one that is followed first is the one to follow."""
    judged = footage.judged(settle_s)
    known = np.array([track.is_known for track in tracks])
    path = np.array([track.position for track in tracks])
    truth = footage.position
    if footage.or_position is not None and known.any():
        k = int(np.argmax(known))
        both = (truth, footage.or_position)
        truth = min(both, key=lambda one: float(np.linalg.norm(one[k] - path[k])))
    error = np.linalg.norm(path - truth, axis=1)
    near = known & (error <= NEAR * np.linalg.norm(truth - EYES_M, axis=1))
    std = np.array(
        [np.sqrt(np.linalg.eigvalsh(track.cov[:3, :3])[-1]) if track.is_known else np.nan for track in tracks]
    )
    counted = error[judged & known]
    after = np.arange(len(tracks)) >= (np.argmax(judged) if judged.any() else 0)
    return Score(
        float(np.mean(near[judged])) if judged.any() else np.nan,
        float(np.sqrt(np.mean(counted**2))) if len(counted) else np.nan,
        float(np.mean((known & ~near & (error > 3 * std))[after])),
    )


def track_ours(params: TrackerParams, footage: Footage, seed: int) -> list[Track3D]:
    """The tracks of all frames; nothing is given."""
    tracker = Tracker(params, footage.rig, np.random.default_rng(seed), own_body=footage.own_body)
    return [tracker.step(frame).track for frame in footage.frames]


class Peers:
    """Two image trackers and our filter, on footage; the boxes in the last few recordings' images are remembered,
    since many disturbances leave one eye's images, or both, as they were."""

    def __init__(self) -> None:
        self._boxes: dict[tuple[str, BoxPx, tuple[int, ...]], tuple[list[Image], _Boxes]] = {}  # newest last

    def track(self, name: ImagePeerName, footage: Footage) -> list[Track3D]:
        """The tracks of all frames, the true boxes given in the first."""
        lefts, rights = [f.left for f in footage.frames], [f.right for f in footage.frames]
        boxes = [self._follow(name, i, b) for i, b in zip((lefts, rights), footage.boxes, strict=True)]
        peer = FilteredPeer(_Replay(footage.rig, iter(zip(*(b[1:] for b in boxes), strict=True))), footage.rig)
        first, *others = footage.frames
        return [peer.start(first, footage.boxes), *(peer.step(frame) for frame in others)]

    def _follow(self, name: ImagePeerName, images: list[Image], box: BoxPx) -> _Boxes:
        key = name, box, tuple(id(image) for image in images)
        known = self._boxes.pop(key, None)
        if known is None:
            tracker = image_peer(name)
            tracker.start(images[0], box)
            known = images, [box, *(tracker.step(image) for image in images[1:])]  # held images keep their ids
        self._boxes[key] = known
        if len(self._boxes) > _REMEMBERED:
            del self._boxes[next(iter(self._boxes))]
        return known[1]


@dataclass(frozen=True)
class _Replay:
    """A stereo peer whose boxes are known already."""

    rig: StereoRig
    boxes: Iterator[tuple[BoxPx | None, BoxPx | None]]

    def start(self, frame: StereoFrame, boxes: tuple[BoxPx, BoxPx]) -> None:
        """Nothing to learn."""

    def step(self, frame: StereoFrame) -> Array | None:
        """Where the rays through the two boxes meet."""
        left, right = next(self.boxes)
        return None if left is None or right is None else meet(self.rig.view_of(frame), left, right)

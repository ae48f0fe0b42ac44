"""The same code on real data nobody here made."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from learning.pps.scores import auroc, brier
from learning.pps.trials import load_trials
from pps_vision.app.track2d import follow
from pps_vision.experiments.pps.perceived import HORIZON_S
from pps_vision.experiments.pps.predictors import by_displacement, in_blocks
from pps_vision.experiments.study import DATA, Study
from pps_vision.geometry.camera import StereoRig
from pps_vision.recordings.formats.stereo_images import open_stereo_images
from pps_vision.recordings.image_sequence import open_frames
from pps_vision.recordings.open import open_recording
from pps_vision.recordings.opencv_calibration import read_stereo_calibration
from pps_vision.types import Array
from tracking.tracker import Tracker, TrackerParams


@dataclass(frozen=True)
class Real(Study):
    """Real data: a ball in one view, a thrown ball in stereo, a robot's touches, a robot's recording.

    What is absent is skipped, saying so.
    """

    data: Path = DATA
    """Folder that holds vot_ball1, baseball, pps_real_robot, yarp_dump (PPS_VISION_DATA, else ../shared/data)."""
    seed: int = 0
    """Seed of the particles."""

    def run(self) -> dict[str, object]:
        """Numbers by data set."""
        parts: dict[str, tuple[Path, Callable[[Path], Mapping[str, float]]]] = {
            "vot_ball1": (self.data / "vot_ball1", partial(ball_iou, seed=self.seed)),
            "baseball": (self.data / "baseball", partial(thrown_ball, seed=self.seed)),
            "pps_real_robot": (self.data / "pps_real_robot" / "trials_forearm_internal.npz", contact_prediction),
            "yarp_dump": (self.data / "yarp_dump", pairing),
        }
        return {name: run(place) if place.exists() else f"skipped: no {place}" for name, (place, run) in parts.items()}


def ball_iou(folder: Path, seed: int) -> dict[str, float]:
    """Mean overlap and share of frames within 20 px of the true centre, first box given."""
    polygons = np.loadtxt(folder / "groundtruth.txt", delimiter=",").reshape(-1, 4, 2)
    low, high = polygons.min(axis=1), polygons.max(axis=1)
    truth = np.concatenate([low, high - low], axis=1)
    x, y, w, h = truth[0]
    rows = follow(open_frames(folder / "frames"), (x, y, w, h), seed)
    boxes = np.array([box for _, box, _ in rows])
    distance = np.linalg.norm(boxes[:, :2] + boxes[:, 2:] / 2 - truth[:, :2] - truth[:, 2:] / 2, axis=1)
    overlap = intersection_over_union(boxes, truth)
    return {
        "mean_iou": float(overlap.mean()),
        "precision_20px": float(np.mean(distance <= 20)),
        "center_px": float(distance.mean()),
    }


def intersection_over_union(a: Array, b: Array) -> Array:
    """(n,) of boxes x, y, w, h (n, 4)."""
    size = np.minimum(a[:, :2] + a[:, 2:], b[:, :2] + b[:, 2:]) - np.maximum(a[:, :2], b[:, :2])
    shared = np.prod(np.maximum(size, 0), axis=1)
    overlap: Array = shared / (np.prod(a[:, 2:], axis=1) + np.prod(b[:, 2:], axis=1) - shared)
    return overlap


def thrown_ball(folder: Path, seed: int, n_seeds: int = 10) -> dict[str, float]:
    """In how many of the frames 8–39 the motion trigger and what follows it have the ball in both views,
    over several seeds of the particles, and how smooth the 3D path is (turn per step, of a step)."""
    recording = open_stereo_images([str(folder / "1L*.jpg")], [str(folder / "1R*.jpg")], fps=30.0)
    calibration = tuple(sorted(folder.glob("calibration_*.xml")))
    left, right, T_left_right = read_stereo_calibration(calibration, recording.image_size, unit_m=0.01)
    frames, rig = list(recording.numbered()), StereoRig.fixed(left, right, T_left_right)
    both, turns = [], []
    for k in range(n_seeds):
        tracker = Tracker(TrackerParams(), rig, np.random.default_rng(seed + k))
        steps = [(number, tracker.step(frame)) for number, frame in frames]
        both.append(sum(len(step.detections) == 2 and 8 <= number <= 39 for number, step in steps))
        path = np.array([step.track.position for _, step in steps if step.track.is_known]).reshape(-1, 3)
        turn = np.linalg.norm(np.diff(path, n=2, axis=0), axis=1) / np.linalg.norm(np.diff(path, axis=0), axis=1)[1:]
        turns.extend(turn)
    return {
        "frames_8_to_39_in_both_views_median": float(np.median(both)),
        "frames_8_to_39_in_both_views_worst": min(both),
        "seeds": n_seeds,
        "median_turn_per_step": float(np.median(turns)) if turns else np.nan,
    }


def contact_prediction(file: Path) -> dict[str, float]:
    """Leave-one-out prediction of touch 0.15 s ahead, beside each taxel's base rate."""
    trials = load_trials(file)
    touched = np.array([trial.touched for trial in trials])
    probability = in_blocks(by_displacement, trials, HORIZON_S)
    base_rate = (touched.sum(axis=0) - touched) / (len(trials) - 1)
    return {
        "auroc": auroc(touched, probability),
        "brier": brier(touched, probability),
        "base_rate_auroc": auroc(touched, base_rate),
        "base_rate_brier": brier(touched, base_rate),
    }


def pairing(folder: Path) -> dict[str, int]:
    """Pairs found at three tolerances, and what is reported as unpaired at the default one."""
    pairs = {
        f"pairs_within_{round(1000 * skew)}_ms": len(open_recording(folder, max_skew_s=skew))
        for skew in (0.010, 0.020, 0.033)
    }
    return {**pairs, "reported_unpaired_at_20_ms": len(open_recording(folder).problems)}

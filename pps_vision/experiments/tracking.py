"""How accurately, how surely and how fast a rendered object is tracked while the head moves."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from pps_vision.app.render import Render
from pps_vision.app.stopwatch import Stopwatch
from pps_vision.app.track import errors_against
from pps_vision.experiments.rendered import rendered
from pps_vision.experiments.scene_sources import by_source
from pps_vision.experiments.study import Scenes, SceneSource, Study
from rendering.names import MotionName, StimulusName
from tracking.names import Mode
from tracking.tracker import Tracker, TrackerParams

MOTIONS: tuple[MotionName, ...] = ("circle", "figure8", "linear", "jerk", "approach")


@dataclass(frozen=True)
class Tracking(Study):
    """Rendered balls (generic tracker) and markers (marker tracker) at 5–15 cm/s while the head moves."""

    n: int = 10
    """Recordings of each, their motions in turn."""
    seconds: float = 5.0
    """Length of each."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    seed: int = 0
    """Seed of the first; the others count up."""
    scenes: Scenes = "both"
    """Rendered scenes, independent ones, or both."""

    def run(self) -> dict[str, object]:
        """Medians and worst over the recordings, by object."""
        if self.n < 1 or self.seconds < 1:
            raise ValueError(f"bench tracking: --n {self.n}, --seconds {self.seconds}; expected at least 1 of each")
        return by_source(
            self.scenes,
            lambda source: {
                "ball": self._measure("ball", "generic", source),
                "marker": self._measure("marker", "marker", source),
            },
        )

    def _measure(self, stimulus: StimulusName, mode: Mode, source: SceneSource) -> dict[str, Any]:
        errors, stopwatch = [], Stopwatch()
        for k in tqdm(range(self.n), desc=f"{source} scenes, {stimulus}", unit="recording", disable=None):
            motion, seed = MOTIONS[k % len(MOTIONS)], self.seed + k
            what = Render(stimulus, motion, Path(), seconds=self.seconds, noise=self.noise, seed=seed)
            film = rendered(what, source)
            rng = np.random.default_rng(seed)
            tracker = Tracker(TrackerParams(mode=mode), film.rig, rng, film.own_body, stopwatch)
            tracks = []
            for frame in film.frames:
                with stopwatch("total"):
                    tracks.append(tracker.step(frame).track)
            errors.append(errors_against(film.truth, tracks))
        rms = np.array([e["position_rms_mm"] for e in errors])
        return {
            "recordings": [{"motion": MOTIONS[k % len(MOTIONS)], **e} for k, e in enumerate(errors)],
            "tracked_share": float(np.mean([e["tracked_share"] for e in errors])),
            "position_rms_mm": float(np.sqrt(np.mean(rms**2))),
            "worst_rms_mm": float(rms.max()),
            "ms_per_pair": stopwatch.summary(),
        }

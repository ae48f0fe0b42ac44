"""How accurately, how surely and how fast a rendered object is tracked while the head moves."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from tqdm import tqdm

from pps_vision.app.render import Render
from pps_vision.app.stopwatch import Stopwatch
from pps_vision.app.track import errors_against, tracker_for
from pps_vision.experiments import parameters
from pps_vision.recordings.yarp import open_yarp
from rendering.names import MotionName, StimulusName
from tracking.names import Mode
from tracking.tracker import TrackerParams

MOTIONS: tuple[MotionName, ...] = ("circle", "figure8", "linear", "jerk", "approach")


class Tracking(parameters.Tracking):
    """The study of these parameters."""

    def run(self) -> dict[str, object]:
        """Medians and worst over the recordings, by object."""
        if self.n < 1 or self.seconds < 1:
            raise ValueError(f"bench tracking: --n {self.n}, --seconds {self.seconds}; expected at least 1 of each")
        return {"ball": self._measure("ball", "generic"), "marker": self._measure("marker", "marker")}

    def _measure(self, stimulus: StimulusName, mode: Mode) -> dict[str, object]:
        errors, stopwatch = [], Stopwatch()
        with TemporaryDirectory() as place:
            for k in tqdm(range(self.n), desc=f"tracking a {stimulus}", unit="recording", disable=None):
                folder = Path(place) / str(k)
                Render(
                    stimulus,
                    MOTIONS[k % len(MOTIONS)],
                    folder,
                    seconds=self.seconds,
                    noise=self.noise,
                    seed=self.seed + k,
                ).record()
                recording = open_yarp(folder)
                tracker = tracker_for(recording, TrackerParams(mode=mode), self.seed + k, stopwatch)
                tracks = []
                for frame in recording:
                    with stopwatch("total"):
                        tracks.append(tracker.step(frame).track)
                errors.append(errors_against(recording.truth, tracks))
        rms = np.array([e["position_rms_mm"] for e in errors])
        return {
            "recordings": [{"motion": MOTIONS[k % len(MOTIONS)], **e} for k, e in enumerate(errors)],
            "tracked_share": float(np.mean([e["tracked_share"] for e in errors])),
            "position_rms_mm": float(np.sqrt(np.mean(rms**2))),
            "worst_rms_mm": float(rms.max()),
            "ms_per_pair": stopwatch.summary(),
        }

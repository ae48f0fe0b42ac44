"""Trials of R's sessions, exact, or rendered and tracked while the eyes follow."""

from dataclasses import dataclass, replace
from functools import cache
from hashlib import sha256

import numpy as np
from tqdm import tqdm

from learning.pps.joint_offsets import TouchTrial
from learning.pps.memory import PPSMemory
from pps_vision.app.encounters.encounter import TRIALS, SessionName
from pps_vision.app.pipeline import Pipeline, PipelineParams
from pps_vision.app.sessions import STEP_S, Movement, gaze_mask, movements
from pps_vision.experiments.study import NOISE_SIGMA, PartsStudy
from pps_vision.robot.icub import icub_rig, load_icub
from pps_vision.robot.silhouette import Silhouette
from pps_vision.robot.skin import icub_skin
from pps_vision.types import Array, Track3D
from pps_vision.worker_pool import worker_pool
from rendering.eyes import Eyes
from rendering.scene import SceneState
from rendering.sensor import Sensor
from rendering.stimuli import make_stimulus
from tracking.tracker import Tracker, TrackerParams

_PROCESSES = 2


@dataclass(frozen=True)
class SessionStudy(PartsStudy):
    """Base of the studies of R's sessions."""

    share: float = 1.0  # share of the trials of every session

    def size(self, n: int) -> int:
        """Return the share of `n` trials."""
        return max(round(self.share * n), 1)

    def measured_trials(
        self, session: SessionName, n: int | None = None, seed_offset: int = 0
    ) -> tuple[TouchTrial, ...]:
        """Return a session's trials (default: as many as R's): the felt double touch exact, all others rendered."""
        n = self.size(n or TRIALS[session])
        if session == "motor":
            return exact_trials(session, n, self.seed + seed_offset)
        return rendered_trials(session, n, self.seed + seed_offset)


def exact_trials(session: SessionName, n: int, seed: int) -> tuple[TouchTrial, ...]:
    """Return the first `n` trials of a session with the true path of the object."""
    return tuple(movement.trial for movement in movements(session, n, seed))


@cache  # several parts use the same trials
def rendered_trials(session: SessionName, n: int, seed: int) -> tuple[TouchTrial, ...]:
    """Return the first `n` trials of a session (not motor, which is felt) as tracked in rendered eye views."""
    planned = movements(session, n, seed)
    with worker_pool(min(_PROCESSES, n)) as pool:
        return tuple(tqdm(pool.map(_render, planned), "rendering", n, unit="trial", disable=None))


def _render(movement: Movement) -> TouchTrial:
    """The trial of a movement as tracked in rendered eye views, the eyes following the track."""
    is_marker = movement.stimulus == "marker"
    icub = load_icub()
    skin = icub_skin()
    rig = icub_rig(icub)
    rng = _noise_rng(movement)
    tracker = Tracker(TrackerParams("marker" if is_marker else "generic"), rig, rng, own_body=Silhouette(icub))
    pipeline = Pipeline(PipelineParams(), icub, skin, tracker, PPSMemory.empty(skin), rng)
    tracks: list[Track3D] = []
    joints: list[Array] = []
    true = movement.trial
    q = true.joints_rad[0]
    stimulus = make_stimulus(movement.stimulus)
    with Eyes(icub, rig, stimulus, "none" if is_marker else "hand", Sensor(noise_sigma=NOISE_SIGMA)) as eyes:
        for t, arms, p in zip(true.stamps_s, true.joints_rad, true.positions, strict=True):
            q = np.where(gaze_mask(icub), q, arms)
            step = pipeline.step(eyes.render(SceneState(q, p, rotation=movement.rotation), t, rng))
            tracks.append(step.tracking.track)
            joints.append(q)
            q = icub.clamp(q + STEP_S * step.command.dq_rad_s)
    return replace(
        true,
        joints_rad=np.array(joints),
        positions=np.array([track.position for track in tracks]),
        velocities=np.array([track.velocity for track in tracks]),
        velocity_covs=np.array([track.cov[3:6, 3:6] for track in tracks]),
        radius_m=np.array([track.radius_m for track in tracks]),
    )


def _noise_rng(movement: Movement) -> np.random.Generator:
    """Generator of the images' noise, which the movement determines."""
    trial = movement.trial
    arrays = (movement.rotation, trial.stamps_s, trial.joints_rad, trial.positions)
    key = f"{movement.stimulus} {NOISE_SIGMA}".encode() + b"".join(array.tobytes() for array in arrays)
    return np.random.default_rng(int(sha256(key).hexdigest()[:24], 16))

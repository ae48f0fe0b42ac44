"""Trials of R's sessions: exact, or rendered and tracked while the eyes follow."""

from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

import numpy as np
from tqdm import tqdm

from learning.archive import read_archive, write_archive
from learning.pps.joint_offsets import TouchTrial
from learning.pps.memory import PPSMemory
from pps_vision.app.encounters.encounter import TRIALS, SessionName
from pps_vision.app.pipeline import Pipeline, PipelineParams
from pps_vision.experiments.pps.movements import STEP_S, Movement, gaze_mask, movements
from pps_vision.experiments.study import NOISE_SIGMA, PartsStudy, SeededStudy, code_digest
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

FOLDER = Path("build") / "pps"  # default folder of the rendered trials, which several studies share
_PROCESSES = 2
_KIND = "touch trial"
_VERSION = 1
_TRACKED = ("joints_rad", "positions", "velocities", "velocity_covs", "radius_m")


@dataclass(frozen=True)
class SessionStudy(PartsStudy, SeededStudy):
    """Base of the studies of R's sessions."""

    trials: Path = FOLDER  # folder of the rendered trials
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
        return rendered_trials(session, n, self.seed + seed_offset, self.trials)


def exact_trials(session: SessionName, n: int, seed: int) -> tuple[TouchTrial, ...]:
    """Return the first `n` trials of a session with the true path of the object."""
    return tuple(movement.trial for movement in movements(session, n, seed))


def rendered_trials(session: SessionName, n: int, seed: int, folder: Path) -> tuple[TouchTrial, ...]:
    """Return the first `n` trials of a session (not motor, which is felt) as tracked in rendered eye views.

    `folder` keeps every trial under a name that identifies movement and code: a trial is rendered once, and an
    interrupted run resumes.
    """
    planned = movements(session, n, seed)
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"{movement.stimulus}_{_digest(movement, code_digest())}.npz" for movement in planned]
    missing = [(movement, file) for movement, file in zip(planned, files, strict=True) if not file.exists()]
    if missing:
        with worker_pool(min(_PROCESSES, len(missing))) as pool:
            rendered = pool.map(_render_to, *zip(*missing, strict=True))
            list(tqdm(rendered, "rendering", len(missing), unit="trial", disable=None))
    return tuple(_read(movement, file) for movement, file in zip(planned, files, strict=True))


def _render_to(movement: Movement, file: Path) -> None:
    """Write a movement as tracked in rendered eye views, the eyes following the track."""
    is_marker = movement.stimulus == "marker"
    icub = load_icub()
    skin = icub_skin()
    rig = icub_rig(icub)
    rng = np.random.default_rng(int(_digest(movement), 16))  # the noise depends on the movement, not on the code
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
    samples = [(q, t.position, t.velocity, t.cov[3:6, 3:6], t.radius_m) for q, t in zip(joints, tracks, strict=True)]
    arrays = map(np.array, zip(*samples, strict=True))
    write_archive(file, _KIND, _VERSION, dict(zip(_TRACKED, arrays, strict=True)))


def _read(movement: Movement, file: Path) -> TouchTrial:
    stored = read_archive(file, _KIND, _VERSION, _TRACKED)
    return replace(movement.trial, **{name: stored[name].astype(float) for name in _TRACKED})


def _digest(movement: Movement, code: bytes = b"") -> str:
    """Hexadecimal digest of a movement, and of the `code`."""
    digest = sha256(code)
    digest.update(f"{movement.stimulus} {NOISE_SIGMA}".encode())
    for array in (movement.rotation, movement.trial.stamps_s, movement.trial.joints_rad, movement.trial.positions):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:24]

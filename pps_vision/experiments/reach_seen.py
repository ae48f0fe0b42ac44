"""Maps of a hand that the eyes see (`session babbling`, `reach train --from`), on robots that err.

The programs take the robot to be the iCub; the true one has other links, encoders and cameras (R's sources of error).
20 000 postures are projected into its eyes, with the errors in pixels of rendered and tracked ones.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from tqdm import tqdm

from learning.reach.babbling import SeenHand
from learning.reach.labels import HandModel, ReachOracle
from learning.reach.params import ArmLimits, MapParams
from learning.reach.training import train_reachable_map
from pps_vision.app import sessions
from pps_vision.app.encounters.robots import ErrorSources, MiscalibratedRobot, true_robot
from pps_vision.app.simulation import Side
from pps_vision.app.track import TrackedRecording, tracker_params
from pps_vision.experiments.reach_truth import BOX, map_params, rates, to_root
from pps_vision.experiments.study import NOISE_SIGMA, interval
from pps_vision.experiments.tables import Table, estimate, judged
from pps_vision.geometry.camera import StereoRig
from pps_vision.geometry.triangulation import triangulate
from pps_vision.recordings.open import open_recording
from pps_vision.robot.gaze import GazeLimits, GazeModel, gaze_for_points
from pps_vision.robot.icub import icub_setup, set_gaze
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Mask

ERRORS_M = (0.0, 0.03)
_SIDE: Side = "right"
_QUANTILES = (50, 90, 99)
_SLACK_SAMPLES = 40  # the slack of the joints stays in a movement between two random postures
_SOME = 300  # postures by which a robot's error is scaled
_GOAL_PERCENT = 0.5


def run(study: Any) -> dict[str, Any]:
    """Return the errors in mm of seen hands, rendered and projected, and JE (percent) by robot error and map."""
    errors_px, _ = _rendered(study.n_rendered, study.seed)
    cov_px = np.cov(errors_px.T)
    _, rendered = _rendered(study.n_rendered, study.seed + 1)
    robot, _, _ = true_robot()
    exact = _robot(0.0, study.seed)
    rng = np.random.default_rng(study.seed + 1)
    q, hand, _ = _see(exact, _postures(study.n_rendered, study.seed + 1), cov_px, rng)
    projected = np.linalg.norm(hand - _felt(robot, q), axis=1)
    maps = {}
    for error_m in ERRORS_M:
        seeds = tqdm(study.seeds, desc=f"robots that err by {100 * error_m:g} cm", disable=None)
        robots = [_judge(study, error_m, seed, cov_px) for seed in seeds]
        maps[f"{100 * error_m:g} cm"] = {key: interval([[je[key]] for je in robots]) for key in robots[0]}
    mm = {"rendered": rendered, "projected": projected}
    return {"maps": maps, "mm": {name: (1000 * np.nanpercentile(e, _QUANTILES)).tolist() for name, e in mm.items()}}


def table(numbers: dict[str, Any]) -> Table:
    """Return JE by robot error."""
    header = ["JE (%)", "hand as seen", "robot's own model", "hand as seen, J's box", "own model, J's box"]
    rows = []
    for error, maps in numbers["maps"].items():
        cells = [estimate(maps[key], 2) for key in ("seen", "own", "seen_box", "own_box")]
        cells[0] = judged(cells[0], maps["seen"][0] > _GOAL_PERCENT)
        rows.append([f"robot's error {error}", *cells])
    return Table(header, rows)


def _rendered(n: int, seed: int) -> tuple[Array, Array]:
    """Errors of rendered and tracked hands: (k, 4) px in the left and right image, and (k,) m."""
    with TemporaryDirectory() as folder:
        out = Path(folder) / "babbled"
        sessions.record([sessions.babbling(_SIDE, n, seed)], out, NOISE_SIGMA, seed)
        recording = open_recording(out, robot=icub_setup())
        steps = list(TrackedRecording(recording, tracker_params("marker", objects=1), seed))
    pixels = []
    errors_m = []
    for step, truth in zip(steps, recording.truth, strict=True):
        if step.observation is not None:
            left, right = (detection.center_px for detection in step.detections)
            pixels.append(np.concatenate([left - truth.left_px, right - truth.right_px]))
            errors_m.append(np.linalg.norm(step.observation.p_root - truth.position))
    return np.array(pixels), np.array(errors_m)


def _judge(study: Any, error_m: float, seed: int, cov_px: Array) -> dict[str, float]:
    """JE (percent) of both maps of one robot, of all gaze postures and of J's box."""
    robot, rig, _ = true_robot()
    postures = _postures(study.n_tried, seed)
    rng = np.random.default_rng(seed)
    factor = 0.0
    if error_m:
        q, hand, _ = _see(_robot(1.0, seed), postures[:: -(-len(postures) // _SOME)], 1e-6 * np.eye(4), rng)
        factor = error_m / np.sqrt(np.nanmean(np.sum((hand - _felt(robot, q)) ** 2, axis=1)))
    true = _robot(factor, seed)
    q, hand, covs = _see(true, postures, cov_px, rng)
    seen = np.isfinite(hand[:, 0])
    arm = robot.indices(robot.names.arm(_SIDE)[:4])
    model = HandModel.seen(robot, _SIDE, SeenHand(q[seen][:, arm], hand[seen], covs[seen]))
    limits = GazeLimits()
    low, high = np.sort(to_root(BOX.T), axis=0)
    box = gaze_for_points(robot, rng.uniform(low, high, (study.n_test, 3)))
    scores = {}
    maps = {
        name: train_reachable_map(robot, _SIDE, np.random.default_rng(seed), map_params(study.n_labels), forward)
        for name, forward in (("seen", model), ("own", None))
    }
    for where, gaze in (("", rng.uniform(limits.lower, limits.upper, (study.n_test, 3))), ("_box", box)):
        heads = _fixating(robot, np.zeros((len(gaze), robot.n_joints)), gaze)
        points, _ = _triangulated(GazeModel(robot).points(gaze), rig, heads, true.rig, heads - true.joint_offsets_rad)
        judged_at = np.isfinite(points[:, 0])
        reachable = _reachable(true, points[judged_at], rng)
        for name, learned in maps.items():
            scores[name + where] = rates(learned.query(gaze[judged_at]).reachable, reachable)["je"]
    return scores


def _robot(factor: float, seed: int) -> MiscalibratedRobot:
    """The true robot: `model` and `rig` are its own, and its encoders read its joints + `joint_offsets_rad`."""
    return MiscalibratedRobot.draw(ErrorSources().scaled(factor), np.random.default_rng((seed, 1)))


def _postures(n: int, seed: int) -> Array:
    """(n, n_joints) encoders of the session, the head at zero."""
    robot, _, _ = true_robot()
    return np.where(sessions.gaze_mask(robot), 0.0, sessions.babbling(_SIDE, n, seed).trial.joints_rad)


def _felt(robot: Robot, q_rad: Array) -> Array:
    """(n, 3) the hand by a robot's model."""
    names = robot.names.arm(_SIDE)[:4]
    return robot.chain(names, robot.names.palm(_SIDE)).positions(q_rad[:, robot.indices(names)])[0]


def _fixating(robot: Robot, q_rad: Array, gaze: Array) -> Array:
    """Postures (n, n_joints) with the head in gaze postures (n, 3); NaN gaze: the head at zero, the eyes at 30°."""
    gaze = np.where(np.isfinite(gaze), gaze, [0, 0, np.pi / 6])
    return np.array([set_gaze(robot, q, g[0], g[1], 0.0, 0.0, g[2]) for q, g in zip(q_rad, gaze, strict=True)])


def _see(true: MiscalibratedRobot, q: Array, cov_px: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Encoders (n, n_joints) with the eyes on the hand, where it is seen (n, 3), and covariances (n, 3, 3)."""
    robot, rig, _ = true_robot()
    gaze_model = GazeModel(robot)
    noise_px = rng.multivariate_normal(np.zeros(4), cov_px, len(q))
    slack = true.slack_rad * rng.standard_normal((len(q) // _SLACK_SAMPLES + 1, robot.n_joints))
    reading = true.joint_offsets_rad + np.repeat(slack, _SLACK_SAMPLES, axis=0)[: len(q)]
    gaze = gaze_model.gaze(_felt(robot, q))
    for _ in range(2):
        q = _fixating(robot, q, gaze)
        palm = true.model.names.palm(_SIDE)
        hand = np.array([true.model.at(joints).point(palm) for joints in q - reading])
        seen, covs = _triangulated(hand, true.rig, q - reading, rig, q, noise_px, cov_px)
        gaze = gaze_model.gaze(seen)
    return q, seen, covs


def _triangulated(
    points: Array,
    rig: StereoRig,
    q: Array,
    assumed: StereoRig,
    q_assumed: Array,
    noise_px: Array | None = None,
    cov_px: Array | None = None,
) -> tuple[Array, Array]:
    """Points (n, 3) projected by a rig at postures `q`, triangulated by another; NaN where impossible.  And covariances
    (n, 3, 3)."""
    seen = np.full((len(points), 3), np.nan)
    covs = np.full((len(points), 3, 3), np.nan)
    cov_px = np.eye(4) if cov_px is None else cov_px
    for k, point in enumerate(points):
        view = rig.view(q[k])
        pixels = np.concatenate([view.left.project(point), view.right.project(point)])
        pixels = pixels if noise_px is None else pixels + noise_px[k]
        if np.isfinite(pixels).all():
            place = triangulate(assumed.view(q_assumed[k]), pixels[:2], pixels[2:], cov_px[:2, :2], cov_px[2:, 2:])
            if place is not None:
                seen[k], covs[k] = place.p_root, place.cov_root
    return seen, covs


def _reachable(true: MiscalibratedRobot, points: Array, rng: np.random.Generator) -> Mask:
    """(n,) whether the true arm reaches points (n, 3) with its encoders within J's limits: by inverse kinematics from
    16 starts, on the exact robot the same as in closed form."""
    names = true.model.names.arm(_SIDE)[:4]
    offsets = true.joint_offsets_rad
    forward = true.model.chain(names, true.model.names.palm(_SIDE), -offsets).positions
    arm = offsets[true.model.indices(names)]
    limits = ArmLimits()
    lower, upper = (tuple((np.array(end) - arm).tolist()) for end in (limits.lower_rad, limits.upper_rad))
    params = MapParams(arm_limits=ArmLimits(lower, upper))
    hand = HandModel(forward, points=lambda at: at, gaze=lambda at, _: at)
    return ReachOracle(true.model, _SIDE, params, rng, hand).verdicts(points)

"""The demos: learn in simulation which approaches touch, then avoid a new object; and encounters, side by side without
and with avoidance: the best, the median and every failed one."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import get_args

import cv2
import numpy as np

from control.avoidance import AvoidanceParams
from learning.pps.memory import PPSMemory, save_memory
from learning.reach.map import ReachableMap
from learning.reach.params import ArmLimits, MapParams
from learning.reach.training import train_reachable_map
from pps_vision.app import simulation, versions
from pps_vision.app.encounters.encounter import HAZARDS, TRIALS, EncounterScene, draw
from pps_vision.app.encounters.robots import MiscalibratedRobot
from pps_vision.app.encounters.training import calibrate, learn, learn_from, training_trials
from pps_vision.app.pipeline import with_offsets
from pps_vision.app.progress import progress
from pps_vision.app.report import figures, page
from pps_vision.app.report.overlay import VideoFile, draw_legend, draw_pair, flash, save_png
from pps_vision.app.report.path3d import PATH_SCRIPT, body_lines, path3d
from pps_vision.app.simulation import Episode, EpisodeLog, Kind, Policy, SimulationScene, SimulationStep
from pps_vision.app.stopwatch import Stopwatch
from pps_vision.errors import InputError
from pps_vision.recordings import REPORT, SUMMARY
from pps_vision.recordings.atomic_write import whole_folder, write_json
from pps_vision.recordings.robot_file import read_robot
from pps_vision.robot.gaze import GazeLimits
from pps_vision.robot.icub import HOME_ARM_RAD
from pps_vision.robot.skin import TOUCH_RADIUS_M
from pps_vision.types import Array, Image, ReachStatus, Status

_TAXEL = 2  # index of a trained one; the octopus comes at it
THRESHOLD = AvoidanceParams(HOME_ARM_RAD).threshold
_GAZE = GazeLimits(pitch_rad=(np.deg2rad(-80.0), np.deg2rad(40.0)))  # J's pitch, and as far down as the eyes' tilt
_FEWEST_SAMPLES = 50  # before touches, of a taxel whose landscape is shown
_TOUCH_EVERY = 3  # training approaches; the others stop before the skin
_ERROR_M = 0.03  # by which the robot of the last two episodes misjudges where objects touch its skin, RMS
_TOUCHES = 20  # of its palm, that it then learns from
_NORMAL_M = 0.012  # length of the line that shows a taxel
_EPISODES: tuple[tuple[Kind, bool, str], ...] = (
    ("approach", False, "octopus approaching, avoidance off"),
    ("approach", True, "octopus approaching, avoidance on"),
    ("recede", True, "octopus receding"),
    ("static", True, "octopus at rest"),
)
_ERRING = f"robot {100 * _ERROR_M:g} cm off, nothing learned", f"the same after {_TOUCHES} touches"
_PALM = "left_palm:101"
_COLUMNS = {
    "touched": "touched",
    "smallest_gap_mm": "smallest gap (mm)",
    "highest_activation": "highest activation before a touch",
    "activation_at_command": "activation when the arm first moves (1 if touched)",
    "predicted_after_s": f"above {THRESHOLD:g} after (s)",
    "arm_moved": "arm moved",
    "track_rms_mm": "3D RMS (mm)",
    "reachable_share": "reachable (share)",
    "degree_of_reach": "degree of reach",
    "mismatch_deg": "posture off its prediction (°)",
}


def demo(out: Path, trials: int, noise: float, seed: int, robot: Path | None = None) -> None:
    """Train, run the episodes, and write the report; arguments as of `pps-vision demo`."""
    setup = read_robot(robot) if robot else None
    with whole_folder(out) as folder, simulation.open_scene(noise, seed, setup) as scene:
        memory = simulation.train(scene, trials, _TOUCH_EVERY)
        save_memory(folder / "memory.npz", memory)
        with progress(total=1, desc="reachable space", unit="map", after_s=0.0) as bar:
            map_params = MapParams(gaze_limits=_GAZE, n_labels=3000, round_labels=750)
            if robot:
                map_params = replace(map_params, arm_limits=ArmLimits.of(scene.robot, scene.side))
            reachable_map = train_reachable_map(scene.robot, scene.side, np.random.default_rng(seed), map_params)
            bar.update()
        reachable_map.save(folder / "reach.npz")
        stopwatch = Stopwatch()
        logs = _run_episodes(scene, memory, reachable_map, folder, stopwatch, seed)
        numbers = {log.title: _numbers(log) for log in logs}
        settings = {"versions": versions.versions(), "seed": seed, "trials": trials, "noise_grey_levels": noise}
        write_json(folder / SUMMARY, {**settings, "ms_per_pair": stopwatch.summary(), "episodes": numbers})
        command = f"pps-vision demo --trials {trials} --noise {noise:g} --seed {seed}"
        command += f" --robot {shlex.quote(str(robot))}" if robot else ""
        page.write_page(
            folder,
            "Vision predicts the touch, the arm avoids it",
            f"{_outcome(logs)} "
            f"A simulated {scene.robot.urdf.stem if robot else 'iCub'} with rendered eye views of 320×240 "
            f"pixels, pixel noise σ = {noise:g}/255, seed {seed}. "
            "The skin was trained with a ball and a cube. The octopus is new.",
            page.video(folder / "demo.mp4"),
            _sections(scene, command, trials, memory, logs, stopwatch),
            PATH_SCRIPT,
        )
    for log in logs:
        touched = "touched" if log.was_touched else "not touched"
        print(f"{log.title:42s} {touched:12s} arm {'moved' if log.was_commanded else 'still'}{_mismatch(log)}")
    print(f"→ {out / REPORT}")


def _run_episodes(
    scene: SimulationScene, memory: PPSMemory, reachable_map: ReachableMap, folder: Path, timer: Stopwatch, seed: int
) -> list[EpisodeLog]:
    """Run and film the episodes, of an iCub also those of one that errs; demo.png shows the first touch without
    avoidance. Returns their logs."""
    logs: list[EpisodeLog] = []
    images: list[list[Image]] = []
    aim = scene.trained_taxels[_TAXEL % len(scene.trained_taxels)]
    runs: list[tuple[Kind, bool, str, str, Policy | None]] = [(*episode, aim, None) for episode in _EPISODES]
    if _PALM in scene.skin.taxel_ids:
        runs += [("approach", True, title, _PALM, policy) for title, policy in erring_robots(scene, seed).items()]
    for kind, avoid, title, taxel, erring in progress(runs, desc="episodes", unit="episode", after_s=0.0):
        # the same seed for all approaches: the same path without avoidance and with it
        rng = np.random.default_rng((seed, get_args(Kind).index(kind)))
        episode = replace(simulation.make_episode(kind, scene, taxel, "octopus", rng, speed_m_s=0.10), title=title)
        policy = erring or simulation.new_pipeline(scene, memory, timer, reachable_map).step
        steps = list(simulation.simulate(scene, episode, policy, avoid))
        images.append([drawn(scene, step, title) for step in steps])
        logs.append(simulation.log_of(scene, episode, steps, avoid))
    write_side_by_side(folder / "demo.mp4", *zip(images[::2], images[1::2], strict=True))
    touching = int(np.argmax(logs[0].touched.any(axis=1)))
    save_png(folder / "demo.png", np.hstack([images[0][touching], images[1][touching]]))
    return logs


def erring_robots(scene: SimulationScene, seed: int) -> dict[str, Policy]:
    """An iCub that misjudges where its skin is touched, by title: with nothing learned, and after touches of its palm
    and as many passing objects, simulated without rendering."""
    world = EncounterScene()
    trials = [*training_trials(world, "left", seed, _TOUCHES / TRIALS["palm"], ["palm"])]
    robot = MiscalibratedRobot.with_error(_ERROR_M, [trial.encounter for trial in trials], (seed,))
    corrected = calibrate(trials, robot, np.random.default_rng((seed, 1)))
    learned = learn_from(world, "left", trials, corrected, np.random.default_rng((seed, 2)), with_others=False)
    naive = robot, PPSMemory.empty(world.skins["left"])
    return {
        title: _misjudging(scene, body, memory, body.reading(np.random.default_rng((seed, 3))))
        for title, (body, memory) in zip(_ERRING, (naive, (corrected, learned.probability)), strict=True)
    }


def _misjudging(scene: SimulationScene, robot: MiscalibratedRobot, memory: PPSMemory, reading: Array) -> Policy:
    """The pipeline of a robot that takes itself to be another than the scene's, with these errors of its encoders."""
    skin = robot.skin.on_arm(robot.model, scene.side)
    setup = replace(scene.setup, robot=robot.model, rig=robot.rig, skin=skin)
    pipeline = simulation.new_pipeline(replace(scene, setup=setup), memory)
    return lambda frame, touched: pipeline.step(with_offsets(frame, reading), touched)


def write_side_by_side(file: Path, *pairs: tuple[Sequence[Image], Sequence[Image]]) -> None:
    """Write a film of pairs of episodes side by side; the shorter episode's last frame is repeated."""
    with VideoFile(file, 1 / simulation.PERIOD_S) as film:
        for left, right in pairs:
            for k in range(max(len(left), len(right))):
                film.add(np.hstack([images[min(k, len(images) - 1)] for images in (left, right)]))


def drawn(scene: SimulationScene, row: SimulationStep, title: str) -> Image:
    """One frame of the video (480, 640, 3): the left eye, and the right one in the corner."""
    activation = row.step.activation
    most = int(np.argmax(activation.probability))
    captions = [title, f"activation {activation.probability[most]:.2f} at {activation.taxel_ids[most]}"]
    if (reach := row.step.reachability) is not None:
        degree = f" (R {reach.degree:.2f})" if np.isfinite(reach.degree) else ""
        captions.append(f"{scene.side} hand: {reach.status.value}{degree}")
    view = scene.rig.view_of(row.frame)
    pair = draw_pair(row.frame, view, row.step.tracking, row.taxels, activation.probability, captions)
    left, right = np.split(pair, 2, axis=1)
    image = left.copy()
    inset = cv2.resize(right, None, fx=0.3, fy=0.3, interpolation=cv2.INTER_AREA)
    image[-inset.shape[0] - 8 : -8, -inset.shape[1] - 8 : -8] = inset
    if row.touched.any():
        flash(image)
    draw_legend(image)
    return image


def _outcome(logs: Sequence[EpisodeLog]) -> str:
    """What happened, in a sentence for each episode."""
    return " ".join(
        f"{log.title[0].upper()}{log.title[1:]}: it {'touched' if log.was_touched else 'did not touch'} the arm, "
        f"which {'moved' if log.was_commanded else 'stayed'}."
        for log in logs
    )


def _numbers(log: EpisodeLog) -> dict[str, object]:
    """The row of an episode in the report's table."""
    error = np.linalg.norm(log.track_m - log.truth_m, axis=1)
    error = error[np.isfinite(error)]
    highest = log.activations.max(axis=1)
    before_touch = highest[: np.append(log.touched.any(axis=1), True).argmax()]
    predicted = np.flatnonzero(before_touch > THRESHOLD)
    commanded = np.flatnonzero(log.arm_commanded)
    tracked = [reach for reach in log.reachability if reach.status != ReachStatus.UNKNOWN]
    degrees = [reach.degree for reach in tracked if reach.status != ReachStatus.NOT_FIXATED]
    return {
        "touched": log.was_touched,
        "arm_moved": log.was_commanded,
        "smallest_gap_mm": 1000 * float(log.surface_gap_m.min()),
        "highest_activation": float(before_touch.max(initial=0.0)),
        "activation_at_command": float(highest[commanded[0]]) if len(commanded) else None,
        "predicted_after_s": float(log.stamps_s[predicted[0]] - log.stamps_s[0]) if len(predicted) else None,
        "tracked_share": sum(status == Status.TRACKING for status in log.status) / len(log.status),
        "track_rms_mm": 1000 * float(np.sqrt(np.mean(error**2))) if len(error) else None,
        "reachable_share": float(np.mean([reach.is_reachable for reach in tracked])) if tracked else None,
        "degree_of_reach": float(np.mean(degrees)) if degrees else None,
        "mismatch_deg": float(np.rad2deg(log.mismatch_rad.max())),
    }


def _mismatch(log: EpisodeLog) -> str:
    """End of an episode's line where the robot was repeatedly not where its commands should have led."""
    frames = np.flatnonzero(log.mismatch_rad > 0)
    if not frames.size:
        return ""
    seconds = log.stamps_s[frames[0]] - log.stamps_s[0]
    return f", up to {np.rad2deg(log.mismatch_rad.max()):.1f}° off the predicted posture from {seconds:.1f} s on"


def _cell(value: object) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.0f}" if isinstance(value, float) and value >= 10 else f"{value:.2f}"


def _sections(
    scene: SimulationScene, command: str, trials: int, memory: PPSMemory, logs: list[EpisodeLog], stopwatch: Stopwatch
) -> Sequence[page.Section]:
    """Sections of the report."""
    rows = [[log.title, *(_cell(_numbers(log)[key]) for key in _COLUMNS)] for log in logs]
    timing = ", ".join(f"{stage} {values['median_ms']:.1f}" for stage, values in stopwatch.summary().items())
    is_tracked = np.isfinite(logs[1].track_m).all(axis=1)
    cov = logs[1].track_std_m[is_tracked, None] ** 2 * np.eye(3)
    touched = np.flatnonzero(memory.samples[:, 0] >= _FEWEST_SAMPLES).tolist()
    parts = " and ".join(part.name.replace("_", " ") for part in scene.skin.parts)
    return (
        (
            "Result",
            "A touch is the object's surface within 20 mm of a taxel's centre. The gap is the true distance from the "
            "surface to the nearest taxel's centre. The object at rest first moves 5 cm away from the skin. Reach is "
            f"the learned map's answer for the {scene.side} hand and the gaze that fixates the object.",
            page.table(["episode", *_COLUMNS.values()], rows),
        ),
        (
            "Distance, activation, response, reach",
            f"One thin line for each taxel of {parts}. The arm withdraws when an activation exceeds "
            f"{THRESHOLD:g}, these taxels at up to 10 cm/s, and returns 0.3 s after the last. Red: touch. Bottom row: "
            f"degree of reach R of the tracked object for the {scene.side} hand, on green where reachable; no line "
            "where nothing is tracked or no gaze fixates it.",
            page.image(figures.episodes(logs[: len(_EPISODES)], THRESHOLD)),
        ),
        *(_erring_section(logs[len(_EPISODES) :]) if len(logs) > len(_EPISODES) else ()),
        (
            "What the skin learned",
            "Probability of touch over distance D and time to contact TTC of an object on its way to the taxel, after "
            f"{trials} rendered approaches of a ball and a cube: one in {_TOUCH_EVERY} touches, the others stop "
            "4–16 cm before the skin. A touch begins at D = 2 cm. Taxels with fewer than "
            f"{_FEWEST_SAMPLES} samples before touches are left out.",
            page.image(figures.landscapes(memory, touched)),
        ),
        (
            "Robot, skin and path",
            "Turn it with the mouse. Blue: tracked position of the octopus with its own 95 % ellipsoids; black: the "
            "truth. Grey: the robot's bodies, the line between its eyes and its taxels (a short line along each "
            "normal) at the start; orange and red: the same where the arm has moved farthest, avoidance on.",
            path3d(_scene(scene, logs[1]), logs[1].track_m[is_tracked], cov),
        ),
        (
            "Coordinates",
            "Tracked position of the octopus with its own ±2σ, and the truth.",
            page.image(figures.path(logs[1])),
        ),
        ("Time", f"Median milliseconds for each stage of a stereo pair on this machine: {timing}.", ""),
        (
            "Made with",
            "The same command with the same versions gives the same numbers, but for times.",
            page.table(["", ""], [["command", command], *map(list, versions.machine(versions.commit()).items())]),
        ),
    )


def _erring_section(logs: Sequence[EpisodeLog]) -> tuple[page.Section]:
    text = (
        f"This iCub misjudges by {100 * _ERROR_M:g} cm (RMS) where objects touch its palm: encoders, links, taxels and "
        "cameras are off. The octopus comes to the palm on the same path both times. Left: nothing is learned, so no "
        f"taxel is activated before the touch. Right: the same robot after {_TOUCHES} touches of the palm and as many "
        "objects that passed, simulated without rendering; they also correct its encoders where held-out touches "
        "confirm it. Links without skin keep clear by geometry in both."
    )
    return (("A robot that errs", text, page.image(figures.episodes(logs, THRESHOLD))),)


def _scene(scene: SimulationScene, log: EpisodeLog) -> list[tuple[str, Array]]:
    """Lines of the 3D view: the track, the truth, and the robot at the start and where its arm has moved farthest."""
    moved = np.linalg.norm(log.q_rad[:, scene.arm] - log.q_rad[0, scene.arm], axis=1)
    lines = [("#2060c0", log.track_m), ("#222222", log.truth_m)]
    for color, skin_color, q in (
        ("#c8c8c8", "#c8c8c8", log.q_rad[0]),
        ("#e09040", "#d02020", log.q_rad[int(moved.argmax())]),
    ):
        posture = scene.robot.at(q)
        points, normals = scene.skin.at(posture)
        gap = np.full_like(points, np.nan)
        view = scene.rig.view(q)
        lines += [(color, body_lines(posture)), (color, np.array([view.left.center, view.right.center]))]
        lines.append((skin_color, np.stack([points, points + _NORMAL_M * normals, gap], axis=1).reshape(-1, 3)))
    return lines


@dataclass(frozen=True)
class DemoEncounter:
    """A rendered encounter without and with avoidance."""

    title: str
    logs: tuple[EpisodeLog, EpisodeLog]  # without and with avoidance
    video: Path
    is_touched: bool  # whether a taxel was touched in spite of avoidance
    left_m: float  # smallest distance that was left until a touch, with avoidance


def demo_encounters(out: Path, n: int, noise: float, seed: int, share: float = 1.0, robot: Path | None = None) -> None:
    """Meet n objects that stop at the would-be contact, press on, fly through or graze, and write the report.

    `bench encounters` with the same seed has the same encounters. `noise`: σ of the pixels, grey levels of 255; `share`
    of R's numbers of training approaches, without rendering; `robot`: as of `pps-vision demo`.
    """
    if n < 1:
        raise InputError("demo", f"--encounters {n}; expected at least 1")
    scene = EncounterScene(read_robot(robot) if robot else None)
    sides = dict.fromkeys(side for side, _ in scene.targets)
    with whole_folder(out) as folder, TemporaryDirectory() as videos:
        memories = {side: learn(scene, side, seed, share).probability for side in sides}
        encounters = []
        for k in progress(range(n), desc="encounters", unit="encounter", after_s=0.0):
            encounter = draw(scene, HAZARDS[k % len(HAZARDS)], k // len(HAZARDS), seed)
            runs = []
            for avoid in (False, True):
                with simulation.open_scene(noise, seed + k, scene.setup_of(encounter), encounter.side) as rendered:
                    pipeline = simulation.new_pipeline(rendered, memories[encounter.side])
                    title = "avoidance on" if avoid else "avoidance off"
                    episode = Episode(title, encounter.stimulus, encounter.motion, encounter.seconds)
                    steps = list(simulation.simulate(rendered, episode, pipeline.step, avoid))
                    images = [drawn(rendered, step, title) for step in steps]
                    runs.append((simulation.log_of(rendered, episode, steps, avoid), images))
            (off, images_off), (on, images_on) = runs
            video = Path(videos) / f"{k}.mp4"
            write_side_by_side(video, (images_off, images_on))
            speed = f"{100 * encounter.speed_m_s:.0f} cm/s, {encounter.side} {encounter.part}"
            title = f"{encounter.condition} {encounter.number}: {encounter.stimulus}, {speed}"
            left_m = float(on.surface_gap_m.min()) - TOUCH_RADIUS_M
            encounters.append(DemoEncounter(title, (off, on), video, on.was_touched, left_m))
        rows = [{"encounter": e.title, "touched": e.is_touched, "left_mm": 1000 * e.left_m} for e in encounters]
        settings = {"versions": versions.versions(), "seed": seed, "noise_grey_levels": noise}
        write_json(folder / SUMMARY, {**settings, "encounters": rows})
        touched = sum(encounter.is_touched for encounter in encounters)
        page.write_page(
            folder,
            f"{n} encounters, {touched} touched",
            "Objects that stop at the would-be contact, press on 3 cm, fly through or graze the skin of a simulated "
            f"{scene.robot.urdf.stem if robot else 'iCub'}, seen by rendered eyes of 320×240 "
            f"pixels, pixel noise σ = {noise:g}/255, seed {seed}. The skin has learned from ball and cube.",
            "",
            _encounter_sections(encounters),
        )
    print(f"{touched} of {n} touched → {out / REPORT}")


def chosen(encounters: Sequence[DemoEncounter]) -> list[tuple[str, DemoEncounter]]:
    """Return the encounters of the report: the best, the median by the distance left, and all that were touched."""
    by_distance = sorted(encounters, key=lambda encounter: encounter.left_m)
    shown = {"Best": by_distance[-1], "Median": by_distance[(len(encounters) - 1) // 2]}
    median = shown["Median"]
    failed = [("Touched", encounter) for encounter in by_distance if encounter.is_touched and encounter is not median]
    return [*shown.items(), *failed] if len(encounters) > 1 else [("Only one", encounters[0])]


def _encounter_sections(encounters: Sequence[DemoEncounter]) -> Sequence[page.Section]:
    rows = [[e.title, "touched" if e.is_touched else "", f"{1000 * e.left_m:.0f}"] for e in encounters]
    text = "The distance is the smallest from the object's surface to a taxel's centre, less the 20 mm of a touch."
    sections: list[page.Section] = [
        ("All encounters", text, page.table(["encounter", "with avoidance", "distance left (mm)"], rows))
    ]
    for rank, encounter in chosen(encounters):
        content = page.video(encounter.video) + page.image(figures.episodes(encounter.logs, THRESHOLD))
        sections.append((f"{rank}: {encounter.title}", "Without avoidance and with it.", content))
    return sections

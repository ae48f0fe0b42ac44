"""The robot learns what touches feel like, then meets something it has never seen."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
from tqdm import tqdm

from control.avoidance import AvoidanceParams
from learning.pps.memory import PPSMemory, save_memory
from learning.reach.map import ReachableMap, save_map
from learning.reach.training import MapParams, train_reachable_map
from pps_vision.app import figures, report
from pps_vision.app.encounter import EncounterLog, Kind, World, make_encounter
from pps_vision.app.overlay import VideoFile, draw_pair
from pps_vision.app.school import fresh_pipeline, open_world, teach
from pps_vision.app.school_params import SchoolParams
from pps_vision.app.stopwatch import Stopwatch
from pps_vision.recordings.outputs import whole_folder, write_json
from pps_vision.robot.gaze import GazeLimits
from pps_vision.robot.icub import HOME_ARM_RAD
from pps_vision.types import ReachStatus, Status

_FILES = ("report.html", "demo.mp4", "memory.npz", "reach.npz", "summary.json")
_TAXEL = "left_forearm:3"
THRESHOLD = AvoidanceParams(HOME_ARM_RAD).threshold
# On the robot the eyes' tilt carries the gaze beyond the neck's pitch; the map is asked there too.
_GAZE = GazeLimits(pitch_rad=(np.deg2rad(-80.0), np.deg2rad(40.0)))


def demo(out: Path, trials: int, noise: float, seed: int) -> None:
    """Learn, meet, and write the report; the arguments are those of `pps-vision demo`."""
    school = SchoolParams(trials, noise)
    with whole_folder(out, _FILES) as folder, open_world(noise, seed) as world:
        memory = teach(world, school)
        save_memory(folder / "memory.npz", memory)
        reachable_map = _train_map(world, seed)
        save_map(folder / "reach.npz", reachable_map)
        stopwatch = Stopwatch()
        with VideoFile(folder / "demo.mp4", fps=20) as film:
            logs = list(_meet_all(world, memory, reachable_map, film, stopwatch, seed))
        numbers = [_numbers(log) | _reach(log) for log in logs]
        write_json(
            folder / "summary.json",
            {
                "seed": seed,
                "trials": trials,
                "noise_grey_levels": noise,
                "ms_per_pair": stopwatch.summary(),
                "encounters": {log.title: n for log, n in zip(logs, numbers, strict=True)},
            },
        )
        (folder / "report.html").write_text(_page(trials, noise, seed, folder, memory, logs, numbers, stopwatch))
    for log in logs:
        print(
            f"{log.title:42s} {'touched' if log.was_touched else 'not touched':12s} "
            f"{'arm moved' if log.was_commanded else 'arm still'}"
        )
    print(f"→ {out / 'report.html'}")


def _meet_all(
    world: World, memory: PPSMemory, reachable_map: ReachableMap, film: VideoFile, stopwatch: Stopwatch, seed: int
) -> Iterator[EncounterLog]:
    """The four encounters with the octopus, filmed."""
    scenes: tuple[tuple[Kind, bool, str], ...] = (
        ("approach", False, "octopus approaching, avoidance off"),
        ("approach", True, "octopus approaching, avoidance on"),
        ("recede", True, "octopus receding"),
        ("static", True, "octopus standing still"),
    )
    start_s = 0.0
    for kind, avoid, title in tqdm(scenes, desc="meeting", unit="encounter", disable=None):
        # the same seed for both approaches: the same path with and without avoidance
        rng = np.random.default_rng((seed, get_args(Kind).index(kind)))
        encounter = replace(make_encounter(kind, world, _TAXEL, "octopus", rng, speed_m_s=0.10), title=title)
        meeting = world.meet(encounter, fresh_pipeline(world, memory, stopwatch, reachable_map), avoid, start_s)
        for frame, step in meeting:
            view = world.rig.view_of(frame)
            taxels, _ = world.skin.at(step.posture)
            most = int(np.argmax(step.activation.probability))
            captions = (title, f"activation {step.activation.probability[most]:.2f} at {world.skin.taxel_ids[most]}")
            film.add(
                draw_pair(
                    frame,
                    view,
                    step.tracking.track,
                    step.tracking.detections,
                    taxels,
                    step.activation.probability,
                    captions,
                )
            )
        log = meeting.log()
        start_s = log.stamps_s[-1] + 1.0
        yield log


def _train_map(world: World, seed: int) -> ReachableMap:
    """What the left hand can reach, by gaze posture."""
    params = MapParams(gaze_limits=_GAZE, n_labels=3000, round_labels=750)
    with tqdm(total=1, desc="reachable space", unit="map", disable=None) as bar:
        learned = train_reachable_map(world.robot, "left", np.random.default_rng(seed), params)
        bar.update()
    return learned


def _reach(log: EncounterLog) -> dict[str, object]:
    """Share of tracked frames in which the map calls the object reachable, and the mean degree where it knows it."""
    tracked = [reach for reach in log.reachability if reach.status != ReachStatus.UNKNOWN]
    degrees = [reach.degree for reach in tracked if reach.status != ReachStatus.NOT_FIXATED]
    return {
        "reachable_share": float(np.mean([reach.is_reachable for reach in tracked])) if tracked else None,
        "degree_of_reach": float(np.mean(degrees)) if degrees else None,
    }


def _numbers(log: EncounterLog) -> dict[str, object]:
    """What the report's table says of an encounter."""
    error = np.linalg.norm(log.track_m - log.truth_m, axis=1)
    known = np.isfinite(error)
    past = np.flatnonzero(log.activations.max(axis=1) > THRESHOLD)
    return {
        "touched": log.was_touched,
        "arm_moved": log.was_commanded,
        "smallest_gap_mm": 1000 * float(log.surface_gap_m.min()),
        "highest_activation": float(log.activations.max()),
        "expected_after_s": float(log.stamps_s[past[0]] - log.stamps_s[0]) if len(past) else None,
        "tracked_share": sum(status == Status.TRACKING for status in log.status) / len(log.status),
        "track_rms_mm": 1000 * float(np.sqrt(np.mean(error[known] ** 2))) if known.any() else None,
    }


_COLUMNS = {
    "touched": "touched",
    "smallest_gap_mm": "smallest gap (mm)",
    "highest_activation": "highest activation",
    "expected_after_s": "first past 0.4 after (s)",
    "arm_moved": "arm moved",
    "track_rms_mm": "3D RMS (mm)",
    "reachable_share": "within reach (share)",
    "degree_of_reach": "degree of reach",
}


def _cell(value: object) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.0f}" if isinstance(value, float) and value >= 10 else f"{value:.2f}"


def _page(
    trials: int,
    noise: float,
    seed: int,
    folder: Path,
    memory: PPSMemory,
    logs: list[EncounterLog],
    numbers: list[dict[str, object]],
    watch: Stopwatch,
) -> str:
    """The report."""
    rows = [[log.title, *(_cell(n[key]) for key in _COLUMNS)] for log, n in zip(logs, numbers, strict=True)]
    timing = ", ".join(f"{stage} {values['median_ms']:.1f}" for stage, values in watch.summary().items())
    stimulated = [i for i in range(len(memory.taxel_ids)) if memory.counts[i].any()]
    sections = (
        report.Section(
            "What happened",
            "A touch is the object's surface within 20 mm of a taxel's centre. The gap is the truth's, from the "
            "surface to the nearest taxel's centre. What stands still first moves 5 cm away from the skin, so that the "
            "eyes have it. Reach is what the learned map says, for the left hand, of the gaze that fixates the object.",
            report.table(["encounter", *_COLUMNS.values()], rows),
        ),
        report.Section(
            "Distance, expectation, reach, answer",
            f"Each thin line is one taxel (left forearm and palm). Where an activation stays past {THRESHOLD:g} for "
            "0.15 s the arm moves away at 10 cm/s; a frame or two, as when something stops dead, do not count. Red "
            "shading is touch. Below, what the map says of the tracked object for the left hand: R above 0.5 (green) "
            "is within reach, and the better the higher; a gap means nothing tracked, or outside the map.",
            report.image(figures.encounters(logs, THRESHOLD)),
        ),
        report.Section(
            "What the skin learned",
            f"After {trials} rendered approaches of a ball and a cube: how likely a stimulus at this distance and "
            "time to contact is to touch the taxel.",
            report.image(figures.landscapes(memory, stimulated)),
        ),
        report.Section(
            "The path in space",
            "What the eyes made of the octopus, with their own uncertainty, against where its centre really was.",
            report.image(figures.path(logs[1])),
        ),
        report.Section(
            "How long it took", f"Median milliseconds a stereo pair and stage on this machine: {timing}.", ""
        ),
    )
    return report.page(
        "Eyes see, skin predicts, the arm gets out of the way",
        f"A simulated iCub, eyes rendered at 320×240 with pixel noise σ = {noise:g}/255, seed {seed}. It has "
        "been touched by a ball and a cube; it has never seen the octopus.",
        report.video(folder / "demo.mp4"),
        sections,
    )

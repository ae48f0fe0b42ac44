"""`pps-vision demo`: the robot learns what touches feel like, then meets something it has never seen."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from control.avoidance import AvoidanceParams
from learning.memory import PPSMemory, save_memory
from learning.reachable_training import MapParams, train_reachable_map
from pps_vision.app import figures, report
from pps_vision.app.encounter import EncounterLog, Kind, World, make_encounter
from pps_vision.app.overlay import VideoFile, draw_pair
from pps_vision.app.school import SchoolParams, fresh_pipeline, open_world, teach
from pps_vision.app.stopwatch import Stopwatch
from pps_vision.recordings.outputs import whole_folder
from pps_vision.recordings.results import write_summary
from pps_vision.robot.gaze import GazeLimits, fixation_point, gaze_for_points
from pps_vision.robot.icub import HOME_ARM_RAD
from pps_vision.types import Status

_FILES = ("report.html", "demo.mp4", "memory.npz", "summary.json")
_TAXEL = "left_forearm:3"
THRESHOLD = AvoidanceParams(HOME_ARM_RAD).threshold
# On the robot the eyes' tilt carries the gaze beyond the neck's pitch; the map is asked there too.
_GAZE = GazeLimits(pitch_rad=(np.deg2rad(-80.0), np.deg2rad(40.0)))


@dataclass(frozen=True)
class Demo:
    """Close the loop: learn the left forearm from rendered approaches, then meet the octopus.

    With avoidance off, with avoidance on, receding, and standing still; everything in report.html.
    """

    out: Path = Path("demo")
    """Folder for report.html, demo.mp4, memory.npz and summary.json."""
    trials: int = 24
    """Approaches of ball and cube to learn from."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    seed: int = 0
    """Seed of everything left to chance."""

    def run(self) -> None:
        """Learn, meet, and write the report."""
        with whole_folder(self.out, _FILES) as folder, open_world(self.noise, self.seed) as world:
            memory = teach(world, SchoolParams(self.trials, self.noise))
            save_memory(folder / "memory.npz", memory)
            stopwatch = Stopwatch()
            with VideoFile(folder / "demo.mp4", fps=20) as film:
                logs = list(_meet_all(world, memory, film, stopwatch, self.seed))
            reach = _reachability(world, logs, self.seed)
            numbers = [_numbers(log) for log in logs]
            write_summary(
                folder / "summary.json",
                {
                    "seed": self.seed,
                    "trials": self.trials,
                    "noise_grey_levels": self.noise,
                    "ms_per_pair": stopwatch.summary(),
                    "encounters": {log.title: n for log, n in zip(logs, numbers, strict=True)},
                },
            )
            (folder / "report.html").write_text(_page(self, folder, memory, logs, reach, stopwatch))
        for log in logs:
            print(
                f"{log.title:42s} {'touched' if log.was_touched else 'not touched':12s} "
                f"{'arm moved' if log.was_commanded else 'arm still'}"
            )
        print(f"→ {self.out / 'report.html'}")


def _meet_all(
    world: World, memory: PPSMemory, film: VideoFile, stopwatch: Stopwatch, seed: int
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
        rng = np.random.default_rng((seed, len(kind)))
        encounter = replace(make_encounter(kind, world, _TAXEL, "octopus", rng, speed_m_s=0.10), title=title)
        meeting = world.meet(encounter, fresh_pipeline(world, memory, stopwatch), avoid, start_s)
        for frame, step in meeting:
            view = world.rig.view_of(frame)
            taxels, _ = world.skin.at(step.posture)
            most = int(np.argmax(step.activations))
            captions = (title, f"activation {step.activations[most]:.2f} at {world.skin.taxel_ids[most]}")
            film.add(
                draw_pair(
                    frame, view, step.tracking.track, step.tracking.detections, taxels, step.activations, captions
                )
            )
        log = meeting.log()
        start_s = log.stamps_s[-1] + 1.0
        yield log


def _reachability(world: World, logs: list[EncounterLog], seed: int) -> list[tuple[float, float]]:
    """For each encounter: share of tracked frames whose fixation the left hand could reach, and the mean degree."""
    params = MapParams(gaze_limits=_GAZE, n_labels=3000)
    reachable_map = train_reachable_map(world.robot, "left", np.random.default_rng(seed), params)
    answers = []
    for log in logs:
        tracked = np.isfinite(log.track_m[:, 0])
        points = [fixation_point(world.robot.at(q)) for q in log.q_rad[tracked]]
        gaze = gaze_for_points(world.robot, np.array([p for p in points if p is not None]).reshape(-1, 3), _GAZE)
        verdict = reachable_map.query(gaze[np.isfinite(gaze[:, 0])])
        known = verdict.within_limits
        share, degree = (
            (np.mean(verdict.reachable[known]), np.mean(verdict.degree[known])) if known.any() else (np.nan, np.nan)
        )
        answers.append((float(share), float(degree)))
    return answers


def _numbers(log: EncounterLog) -> dict[str, object]:
    """What the report's table says of an encounter."""
    error = np.linalg.norm(log.track_m - log.truth_m, axis=1)
    known = np.isfinite(error)
    past = np.flatnonzero(log.activations.max(axis=1) > THRESHOLD)
    nearest = int(np.argmin(log.surface_gap_m.min(axis=1)))
    return {
        "touched": log.was_touched,
        "arm_commanded": log.was_commanded,
        "smallest_gap_mm": 1000 * float(log.surface_gap_m.min()),
        "highest_activation": float(log.activations.max()),
        "warning_s": float(log.stamps_s[nearest] - log.stamps_s[past[0]]) if len(past) else None,
        "tracked_share": sum(status == Status.TRACKING for status in log.status) / len(log.status),
        "track_rms_mm": 1000 * float(np.sqrt(np.mean(error[known] ** 2))) if known.any() else None,
    }


def _page(
    demo: Demo,
    folder: Path,
    memory: PPSMemory,
    logs: list[EncounterLog],
    reach: list[tuple[float, float]],
    watch: Stopwatch,
) -> str:
    """The report."""
    rows = []
    for log, (share, degree) in zip(logs, reach, strict=True):
        n = _numbers(log)
        rows.append(
            [
                log.title,
                "yes" if n["touched"] else "no",
                f"{n['smallest_gap_mm']:.0f}",
                f"{n['highest_activation']:.2f}",
                "–" if n["warning_s"] is None else f"{n['warning_s']:.2f}",
                "yes" if n["arm_commanded"] else "no",
                "–" if n["track_rms_mm"] is None else f"{n['track_rms_mm']:.1f}",
                "–" if np.isnan(share) else f"{100 * share:.0f}",
                "–" if np.isnan(degree) else f"{degree:.2f}",
            ]
        )
    header = (
        "encounter",
        "touched",
        "smallest gap (mm)",
        "highest activation",
        "past 0.4 before nearest (s)",
        "arm moved",
        "3D RMS (mm)",
        "within reach (% of frames)",
        "degree of reach",
    )
    ms = watch.summary()
    timing = ", ".join(f"{stage} {values['median_ms']:.1f}" for stage, values in ms.items())
    inner = [i for i, name in enumerate(memory.taxel_ids) if memory.counts[i].any()]
    sections = (
        report.Section(
            "What happened",
            "A touch is the object's surface within 20 mm of a taxel's centre. The gap is the truth's, from the "
            "surface to the nearest taxel's centre. Reach is what the learned map says of the eyes' fixation "
            "posture for the left hand.",
            report.table(header, rows),
        ),
        report.Section(
            "Distance, expectation, answer",
            "Each thin line is one taxel (left forearm and palm). Where an activation passes 0.4 the arm moves away at "
            "10 cm/s; red shading is touch.",
            report.image(figures.encounters(logs, THRESHOLD)),
        ),
        report.Section(
            "What the skin learned",
            f"After {demo.trials} rendered approaches of a ball and a cube: how likely a stimulus at this distance and "
            "time to contact is to touch the taxel.",
            report.image(figures.landscapes(memory, inner)),
        ),
        report.Section(
            "The path in space",
            "What the eyes made of the octopus, with their own uncertainty, against where it really was.",
            report.image(figures.path(logs[1])),
        ),
        report.Section(
            "How long it took",
            f"Median milliseconds a stereo pair and stage, everything on this machine: {timing}.",
            "",
        ),
    )
    return report.page(
        "Eyes see, skin predicts, the arm gets out of the way",
        f"A simulated iCub, eyes rendered at 320×240 with pixel noise σ = {demo.noise:g}/255, seed {demo.seed}. It has "
        "been touched by a ball and a cube; it has never seen the octopus.",
        report.video(folder / "demo.mp4"),
        sections,
    )

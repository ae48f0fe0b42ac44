"""The demo of encounters: side by side without and with avoidance, the best, the median and every failed one."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import get_args

from pps_vision.app.demo import THRESHOLD, drawn, write_side_by_side
from pps_vision.app.encounters.encounter import HAZARDS, Encounter, EncounterScene, draw
from pps_vision.app.encounters.rendered import open_encounter
from pps_vision.app.encounters.training import learn
from pps_vision.app.progress import progress
from pps_vision.app.report import figures, page
from pps_vision.app.simulation import Episode, EpisodeLog, Side, log_of, new_pipeline, simulate
from pps_vision.app.versions import versions
from pps_vision.errors import InputError
from pps_vision.recordings import REPORT, SUMMARY
from pps_vision.recordings.atomic_write import whole_folder, write_json
from pps_vision.robot.skin import TOUCH_RADIUS_M


@dataclass(frozen=True)
class DemoEncounter:
    """A rendered encounter without and with avoidance."""

    title: str
    logs: tuple[EpisodeLog, EpisodeLog]
    video: Path

    @property
    def is_touched(self) -> bool:
        """Whether a taxel was touched in spite of avoidance."""
        return self.logs[1].was_touched

    @property
    def left_m(self) -> float:
        """Smallest distance that was left until a touch, with avoidance."""
        return float(self.logs[1].surface_gap_m.min()) - TOUCH_RADIUS_M


def demo_encounters(out: Path, n: int, noise: float, seed: int, share: float = 1.0) -> None:
    """Meet n objects that stop at the would-be contact, press on or fly through, and write the report.

    They are those of `bench encounters` with the same seed. `noise`: of the pixels, grey levels of 255; `share`: of R's
    numbers of training approaches, which are not rendered.
    """
    if n < 1:
        raise InputError("demo", f"--encounters {n}; expected at least 1")
    scene = EncounterScene()
    with whole_folder(out) as folder, TemporaryDirectory() as videos:
        memories = {side: learn(scene, side, seed, share).of_both for side in get_args(Side)}
        encounters = []
        for k in progress(range(n), desc="encounters", unit="encounter", after_s=0.0):
            encounter = draw(scene, HAZARDS[k % len(HAZARDS)], k // len(HAZARDS), seed)
            runs = []
            for avoid in (False, True):
                with open_encounter(scene, encounter, noise, seed + k) as simulation:
                    pipeline = new_pipeline(simulation, memories[encounter.side])
                    title = "avoidance on" if avoid else "avoidance off"
                    episode = Episode(title, encounter.stimulus, encounter.motion, encounter.seconds)
                    steps = list(simulate(simulation, episode, pipeline.step, avoid))
                    images = [drawn(simulation, step, title) for step in steps]
                    runs.append((log_of(simulation, episode, steps, avoid), images))
            (off, images_off), (on, images_on) = runs
            video = Path(videos) / f"{k}.mp4"
            write_side_by_side(video, (images_off, images_on))
            encounters.append(DemoEncounter(_title(encounter), (off, on), video))
        rows = [{"encounter": e.title, "touched": e.is_touched, "left_mm": 1000 * e.left_m} for e in encounters]
        settings = {"versions": versions(), "seed": seed, "noise_grey_levels": noise}
        write_json(folder / SUMMARY, {**settings, "encounters": rows})
        touched = sum(encounter.is_touched for encounter in encounters)
        page.write_page(
            folder,
            f"{n} encounters, {touched} touched",
            "Objects that stop at the would-be contact, press on 3 cm or fly through, seen by rendered eyes of 320×240 "
            f"pixels, pixel noise σ = {noise:g}/255, seed {seed}. The skin has learned from ball and cube.",
            "",
            _sections(encounters),
        )
    print(f"{touched} of {n} touched → {out / REPORT}")


def _title(encounter: Encounter) -> str:
    speed = f"{100 * encounter.speed_m_s:.0f} cm/s"
    return f"{encounter.condition} {encounter.number}: {encounter.stimulus}, {speed}, {encounter.side} {encounter.part}"


def chosen(encounters: Sequence[DemoEncounter]) -> list[tuple[str, DemoEncounter]]:
    """Return the encounters of the report: the best, the median by the distance left, and all that were touched."""
    by_distance = sorted(encounters, key=lambda encounter: encounter.left_m)
    shown = {"Best": by_distance[-1], "Median": by_distance[(len(encounters) - 1) // 2]}
    median = shown["Median"]
    failed = [("Touched", encounter) for encounter in by_distance if encounter.is_touched and encounter is not median]
    return [*shown.items(), *failed] if len(encounters) > 1 else [("Only one", encounters[0])]


def _sections(encounters: Sequence[DemoEncounter]) -> list[page.Section]:
    rows = [[e.title, "touched" if e.is_touched else "", f"{1000 * e.left_m:.0f}"] for e in encounters]
    text = "The distance is the smallest from the object's surface to a taxel's centre, less the 20 mm of a touch."
    sections = [("All encounters", text, page.table(["encounter", "with avoidance", "distance left (mm)"], rows))]
    for rank, encounter in chosen(encounters):
        content = page.video(encounter.video) + page.image(figures.episodes(encounter.logs, THRESHOLD))
        sections.append((f"{rank}: {encounter.title}", "Without avoidance and with it.", content))
    return sections

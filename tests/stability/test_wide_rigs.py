"""Two cameras anywhere around the object: their axes 90 to 180° apart, above each other, rolled, or 1 m apart.

A film is right if the object is known in 80 % of the pairs, the median error of what is known is at most 0.3 mm (150°:
0.8 mm; side by side, where depth is less certain: 3 mm), and 95 % of it lies within 10 mm.  None may be warned of.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from wide_rigs import KINDS, SIZE, Kind, WideFilm

from pps_vision.app.diagnosis import diagnose
from pps_vision.app.info import info
from pps_vision.app.track import track
from pps_vision.experiments.severity.inputs import Shot
from pps_vision.geometry.camera import StereoRig
from pps_vision.recordings.recording import Recording

LIMIT_MM = {"90°": 0.3, "150°": 0.8, "180°": 0.3, "vertical": 3.0, "rolled": 3.0, "1 m": 3.0}


def recording(film: WideFilm) -> Recording:
    pairs = tuple(
        tuple(Shot(Path(f"{k}.png"), frame.stamp_s, None, pixels=image) for image in (frame.left, frame.right))
        for k, frame in enumerate(film.stereo_frames)
    )
    return Recording("made up", pairs, SIZE, [], rig=film.rig)


def faults(film: WideFilm) -> list[str]:
    """Faults of a film's recording or its tracking, in words."""
    opened = recording(film)
    found = [*info(opened).warnings]
    run = track(opened)
    tracks = [step.track for step in run]
    known = [t for t in tracks if t.is_known]
    if len(known) < 0.8 * len(tracks):
        return [*found, f"known in {len(known)} of {len(tracks)} pairs"]
    diagnosis = diagnose(opened, "generic", {}, 1.0, (0.0, 0.0), 0.0)
    found += diagnosis.advice if diagnosis else ()
    errors_mm = [1000 * float(np.linalg.norm(t.position - film.position(t.stamp_s))) for t in known]
    if np.median(errors_mm) > LIMIT_MM[film.kind] or np.mean(np.array(errors_mm) > 10) > 0.05:
        found.append(f"{np.median(errors_mm):.2f} mm off, at most {max(errors_mm):.1f} mm")
    return found


@pytest.mark.parametrize(
    "kind", ["180°", *(pytest.param(kind, marks=pytest.mark.long) for kind in ("90°", "150°", "1 m"))]
)
def test_a_ball_between_cameras_far_apart_is_tracked(kind: Kind):
    assert faults(WideFilm(kind, 1, frames=30)) == []


def test_cameras_that_face_each_other_in_a_hall_are_no_mistaken_unit():
    """The same images in three times the size: 5 m between them."""
    film = WideFilm("180°", 2, frames=2)
    opened = recording(film)
    T = film.rig.view().right.T_root_camera.copy()
    T[:3, 3] *= 3
    far = replace(opened, rig=StereoRig.fixed(film.rig.left, film.rig.right, T))
    assert info(far).warnings == ()
    T[:3, 3] *= 100
    wrong = replace(opened, rig=StereoRig.fixed(film.rig.left, film.rig.right, T))
    assert "another calibration or --unit-m" in info(wrong).warnings[0]


@pytest.mark.parametrize("seed", [9002, 9009])
def test_points_of_the_scene_fit_cameras_that_are_rolled(seed):
    """By 90 or 180° to each other; SIFT features a quarter of a pixel off would be told as a wrong calibration."""
    assert info(recording(WideFilm("rolled", seed, frames=2))).warnings == ()


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_of_60_films_57_are_right_and_none_is_warned_of(kind: Kind):
    found = [faults(WideFilm(kind, seed)) for seed in range(9000, 9060)]
    assert sum(not words for words in found) >= 57, found
    assert not [words for words in found if any("try" in word for word in words)]

"""A ball before a wall, ray-cast in front of two known cameras, and how far `track` is from its true path."""

from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import av
import numpy as np
from calibrations import store
from videos import encode

from pps_vision.app.cli import main
from pps_vision.experiments.films.scenes import Film, FilmScene
from pps_vision.geometry.se3 import inverse
from pps_vision.types import Array, Image

SIZE = (320, 240)
SCENE = FilmScene(width=SIZE[0], height=SIZE[1], seconds=1.6, fps=25.0, start="moving")


@cache
def film(seed: int = 6, scene: FilmScene = SCENE) -> tuple[Film, tuple[tuple[Image, ...], tuple[Image, ...]]]:
    """The film, and its left and right images."""
    shown = Film(scene, seed)
    frames = list(shown)
    return shown, (tuple(frame.left for frame in frames), tuple(frame.right for frame in frames))


def calibration(file: Path, shown: Film, size: tuple[int, int] | None = SIZE, **changed: Array) -> Path:
    """Its cameras in OpenCV's form, with the images' size unless None; `changed` replaces matrices."""
    view = shown.rig.view()
    T_right_left = inverse(view.right.T_root_camera) @ view.left.T_root_camera
    matrices = {"R": T_right_left[:3, :3], "T": T_right_left[:3, 3]}
    for side, camera in (("1", shown.rig.left), ("2", shown.rig.right)):
        matrices |= {f"K{side}": camera.K, f"D{side}": camera.lens}
    sizes = dict(zip(("image_width", "image_height"), size or (), strict=False))
    return store(file, **sizes, **(matrices | changed))


def write_video(
    file: Path, images: Iterable[Image], fps: float = 25.0, set_up: Callable[[av.VideoStream], None] = lambda _: None
) -> Path:
    """A video of hardly compressed images; `set_up` changes its stream before it is written."""
    return encode(file, images, fps, pix_fmt="yuv444p", set_up=set_up, qp="4", preset="ultrafast")


def write_videos(
    folder: Path, suffix: str = "mp4", change: Callable[[Image], Image] = lambda image: image, **options: Any
) -> tuple[Film, list[str]]:
    """Videos of both cameras, their images changed, with the calibration; the film, and options of `track`."""
    shown, sides = film()
    words = ["--calib", str(calibration(folder / "calib.yml", shown))]
    for side, images in zip(("left", "right"), sides, strict=True):
        words += [f"--{side}", str(write_video(folder / f"{side}.{suffix}", map(change, images), **options))]
    return shown, words


def errors_mm(file: Path, stamps_s: Array, path: Array) -> Array:
    """Distances of a trajectory.csv from the true path (n, 3), m, at these stamps; NaN where it is not tracked."""
    table = np.genfromtxt(file, delimiter=",", names=True, dtype=None, encoding="utf-8")
    measured = np.column_stack([table[f"{axis}_m"] for axis in "xyz"])
    true = np.column_stack([np.interp(table["stamp_s"], stamps_s, path[:, k]) for k in range(3)])
    return np.where(table["status"] == "tracking", 1000 * np.linalg.norm(measured - true, axis=1), np.nan)


def track_error_mm(
    words: Sequence[object], shown: Film, out: Path, start_s: float = 0.0, R: Array | None = None
) -> float:
    """Median distance of the path that `track` writes from the ball's, whose film begins at `start_s`, in a frame
    turned by R; half of the pairs at least must be tracked."""
    main(["track", *map(str, words), "--one", "--out", str(out)])
    path = np.array([row.position for row in shown.truth]) @ (np.eye(3) if R is None else R.T)
    errors = errors_mm(out / "trajectory.csv", np.array([row.stamp_s for row in shown.truth]) + start_s, path)
    assert np.isfinite(errors).mean() >= 0.5
    return float(np.nanmedian(errors))

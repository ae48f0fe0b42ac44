"""A ball before a wall, ray-cast in front of two known cameras, and how far `track` is from its true path."""

from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import av
import numpy as np
from calibrations import store

from pps_vision.app.cli import main
from pps_vision.experiments.films.scenes import Film, FilmScene
from pps_vision.geometry.se3 import inverse
from pps_vision.types import Array, Image

SIZE = (320, 240)
SCENE = FilmScene(width=SIZE[0], height=SIZE[1], seconds=2.0, fps=25.0, start="moving")


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
    file: Path,
    images: Iterable[Image],
    fps: float = 25.0,
    codec: str = "libx264",
    set_up: Callable[[av.VideoStream], None] = lambda _: None,
) -> Path:
    """A video of hardly compressed images; `set_up` changes its stream before it is written."""
    with av.open(str(file), "w") as container:
        stream = container.add_stream(codec, rate=Fraction(fps).limit_denominator(1001))
        stream.pix_fmt = "yuv420p" if codec == "mpeg2video" else "yuv444p"
        if codec == "mpeg2video":
            stream.codec_context.options = {"qmin": "1", "qmax": "2"}
        else:
            stream.codec_context.options = {"qp": "4", "preset": "ultrafast"}
        set_up(stream)
        for k, image in enumerate(images):
            if k == 0:
                stream.height, stream.width = image.shape[:2]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")))
        container.mux(stream.encode())
    return file


def write_videos(
    folder: Path, suffix: str = "mp4", change: Callable[[Image], Image] = lambda image: image, **options: Any
) -> tuple[Film, list[str]]:
    """Videos of both cameras, their images changed, with the calibration; the film, and options of `track`."""
    shown, sides = film()
    words = ["--calib", str(calibration(folder / "calib.yml", shown))]
    for side, images in zip(("left", "right"), sides, strict=True):
        words += [f"--{side}", str(write_video(folder / f"{side}.{suffix}", map(change, images), **options))]
    return shown, words


def track_error_mm(words: Sequence[object], shown: Film, out: Path, start_s: float = 0.0) -> float:
    """Median distance of the path that `track` writes from the ball's, whose film begins at `start_s`; half of the
    pairs at least must be tracked."""
    main(["track", *map(str, words), "--one", "--out", str(out)])
    table = np.genfromtxt(out / "trajectory.csv", delimiter=",", names=True, dtype=None, encoding=None)
    known = table[table["status"] == "tracking"]
    assert 2 * len(known) > len(table)
    truth = np.array([row.position for row in shown.truth])
    stamps_s = np.array([row.stamp_s for row in shown.truth])
    measured = np.column_stack([known[f"{axis}_m"] for axis in "xyz"])
    true = np.column_stack([np.interp(known["stamp_s"] - start_s, stamps_s, truth[:, k]) for k in range(3)])
    return float(1000 * np.median(np.linalg.norm(measured - true, axis=1)))

"""Writes a recording as yarpdatadumper would have, with its calibration and its truth."""

from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TextIO

import cv2
from numpy.typing import ArrayLike

from pps_vision.recordings.atomic_write import whole_folder, write_json
from pps_vision.recordings.icub_eyes import write_icub_eyes
from pps_vision.recordings.tables import write_truth
from pps_vision.robot.robot_setup import RobotSetup
from pps_vision.types import StereoFrame, Truth

_IMAGES = ("cam/left", "cam/right")


class YarpWriter:
    """A recording being written; as a context manager it appears under its name when all went well.

    Entering raises InputError if `folder` cannot be written or is not empty.  Every kind of row
    may come at its own rate; joints must span the frames' stamps.
    """

    def __init__(self, folder: Path, setup: RobotSetup) -> None:
        self._target = folder
        self._setup = setup
        self._eyes = (setup.rig.left, setup.rig.right)
        self._stack = ExitStack()
        self._logs: dict[str, TextIO] = {}
        self._rows = dict.fromkeys((*_IMAGES, *setup.ports, "skin"), 0)
        self._truth: list[Truth] = []

    def __enter__(self) -> "YarpWriter":
        with ExitStack() as stack:  # closes the opened files if a later one fails
            self._folder = stack.enter_context(whole_folder(self._target))
            for port in self._rows:
                place = self._folder / port
                place.mkdir(parents=True)
                (place / "info.log").write_text(f"Type: {'Image:ppm' if port in _IMAGES else 'Bottle'};\n")
                self._logs[port] = stack.enter_context((place / "data.log").open("w"))
            write_icub_eyes(self._folder / "icubEyes.ini", *self._eyes)
            stack.callback(lambda: write_truth(self._folder / "truth.csv", self._truth))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        self._stack.__exit__(*error)

    def write_frame(self, frame: StereoFrame) -> None:
        """Both images, each at its own stamp."""
        eyes = (("cam/left", frame.left, frame.stamp_left_s), ("cam/right", frame.right, frame.stamp_right_s))
        for port, image, stamp_s in eyes:
            name = f"{self._rows[port]:08d}.ppm"
            pixels = cv2.imencode(".ppm", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1]
            (self._folder / port / name).write_bytes(pixels.tobytes())
            self._write_row(port, stamp_s, [name])

    def write_joints(self, stamp_s: float, q_rad: ArrayLike) -> None:
        """The configuration at a stamp, as every port's encoders read it, in degrees."""
        for port, degrees in self._setup.encoders(q_rad).items():
            self._write_row(port, stamp_s, [f"{value:.9g}" for value in degrees])

    def write_touches(self, stamp_s: float, taxel_ids: Iterable[str]) -> None:
        """The touched virtual taxels "part:id" at a stamp; none is a row without a payload."""
        self._write_row("skin", stamp_s, list(taxel_ids))

    def write_truth(self, row: Truth) -> None:
        """The object's true state at a stamp."""
        self._truth.append(row)

    def write_summary(self, content: Mapping[str, object]) -> None:
        """How the recording was made, as summary.json."""
        write_json(self._folder / "summary.json", content)

    def _write_row(self, port: str, stamp_s: float, words: list[str]) -> None:
        row = " ".join([str(self._rows[port]), repr(float(stamp_s)), *words])
        self._logs[port].write(row + "\n")
        self._rows[port] += 1

"""Memory while a long recording is tracked does not grow with the number of its pairs."""

import gc
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace

import pytest

import pps_vision as pv
from pps_vision.app.cli import main
from pps_vision.app.cli.options import RecordingSource
from pps_vision.recordings.recording import Recording
from pps_vision.types import StereoFrame
from tracking import smoother

LOOPS = 6
PAIRS = 40


@dataclass(frozen=True)
class Looped(Recording):
    """A recording again and again; `held` are the blocks of memory in use at the end of each loop."""

    held: list[int] = field(default_factory=list)

    @classmethod
    def of(cls, recording: Recording) -> "Looped":
        length_s = PAIRS / recording.fps
        later = [
            tuple(replace(file, stamp_s=file.stamp_s + k * length_s) for file in pair)
            for k in range(LOOPS)
            for pair in recording.pairs[:PAIRS]
        ]
        values = {field.name: getattr(recording, field.name) for field in fields(Recording)}
        return cls(**values | {"pairs": tuple(later)})

    def numbered(self) -> Iterator[tuple[int, StereoFrame]]:
        for k, pair in enumerate(super().numbered(), start=1):
            yield pair
            if k % PAIRS == 0:
                gc.collect()
                self.held.append(sys.getallocatedblocks())


@pytest.mark.long
@pytest.mark.parametrize("options", [["--also", "tum", "anipose", "mot", "coco"], ["--smooth"]], ids=" ".join)
def test_memory_does_not_grow(options, approach, tmp_path, monkeypatch):
    recording = Looped.of(pv.open_recording(approach))
    monkeypatch.setattr(RecordingSource, "open", lambda self: recording)
    monkeypatch.setattr(smoother, "LAG", 20)
    main(["track", str(approach), "--out", str(tmp_path / "out"), *options])
    growth = min(recording.held[LOOPS // 2 :]) - min(recording.held[: LOOPS // 2])
    assert growth < 5 * PAIRS * LOOPS // 2  # a track that is kept takes 5, all of a step 50
    assert len((tmp_path / "out" / "trajectory.csv").read_text().splitlines()) == 1 + len(recording)

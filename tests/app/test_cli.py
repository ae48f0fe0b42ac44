"""Version, and the options that a batch passes to its recordings."""

import sys
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import pytest

from pps_vision.app.cli import main
from pps_vision.app.cli.batch import Batch
from pps_vision.app.cli.track import Track
from pps_vision.errors import InputError


def test_the_arguments_are_those_of_the_process(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["pps-vision", "--version"])
    main()
    assert capsys.readouterr().out == f"pps-vision {version('pps-vision')}\n"


def test_a_batch_gives_each_of_its_recordings_the_options_for_all() -> None:
    """With --learn only those that learning knows; the others are refused."""
    bare = Batch(("a",), Path("out"))
    assert bare._options() == ["--mode=generic", "--seed=0", f"--order={Track.order}", "--unit-m=1.0"]
    common = {"mode": "marker", "seed": 4, "max_skew_s": 0.1, "calib": (Path("c.yml"),)}
    tracking = {"fps": 5.0, "unit_m": 0.01, "order": 2, "smooth": True, "also": ("tum", "mot"), "report": True}
    one = replace(bare, **common, **tracking)  # type: ignore[arg-type]
    start = ["--mode=marker", "--seed=4", "--max-skew-s=0.1"]
    calib = ["--calib", str(Path("c.yml").resolve())]
    words = ["--order=2", "--unit-m=0.01", "--fps=5.0", "--smooth", "--report", "--also", "tum", "mot"]
    assert one._options() == [*start, *words, *calib]
    learning = replace(bare, **common, learn=True)  # type: ignore[arg-type]
    assert learning._options() == [*start, *calib]
    for name, value in tracking.items():
        with pytest.raises(InputError, match=f"--learn with --{name.replace('_', '-')}; expected it without"):
            replace(learning, **{name: value})._options()  # type: ignore[arg-type]

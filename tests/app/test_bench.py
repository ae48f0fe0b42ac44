"""What `bench` does with a series: each part its own files, and nothing measured twice by the same code."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from pps_vision.app import bench
from pps_vision.app.cli.bench import Bench
from pps_vision.experiments.experiment import Experiment

runs: list[int] = []


@dataclass(frozen=True)
class Part:
    seed: int = 0

    def run(self) -> dict[str, Any]:
        runs.append(self.seed)
        return {"half": self.seed / 2}


@dataclass(frozen=True)
class Parts:
    first: int = 1

    def parts(self) -> dict[str, Experiment]:
        return {"one": Part(self.first), "two": Part(2)}


def measure(out: Path, first: int) -> list[int]:
    """The seeds that were run when the series is asked for."""
    runs.clear()
    Bench(Parts(first), out / "parts.json", out / "parts.png").run()  # type: ignore[arg-type]
    return list(runs)


def test_an_interrupted_series_goes_on_where_it_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "_commit", lambda: "1234567")
    assert measure(tmp_path, 1) == [1, 2]
    assert measure(tmp_path, 1) == []
    (tmp_path / "parts_two.json").unlink()
    assert measure(tmp_path, 1) == [2]
    assert measure(tmp_path, 5) == [5], "other parameters are another measurement"
    monkeypatch.setattr(bench, "_commit", lambda: "7654321")
    assert measure(tmp_path, 5) == [5, 2], "other code is another measurement"


def test_code_that_is_no_commit_s_is_always_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "_commit", lambda: "1234567-dirty")
    assert measure(tmp_path, 1) == measure(tmp_path, 1) == [1, 2]

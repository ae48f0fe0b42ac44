"""Recordings that several tests read, rendered once."""

import re
from pathlib import Path

import pytest
from calibrations import write_calibration

from pps_vision.app.cli import main


@pytest.fixture(scope="session")
def approach(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ball that approaches taxel 3 of the left forearm, touches it, and withdraws."""
    out = tmp_path_factory.mktemp("recordings") / "approach"
    words = "--stimulus ball --motion approach --target left_forearm:3 --speed 0.12 --seconds 2.4 --noise 2 --seed 11"
    main(["render", *words.split(), "--out", str(out)])
    return out


@pytest.fixture
def calib(tmp_path: Path) -> Path:
    return write_calibration(tmp_path / "calib.yml", 80.0, (40.0, 60.0))


@pytest.fixture
def fails_in_part():
    """Runs a batch of which some recordings must fail, and some not."""

    def run(*args: object) -> None:
        with pytest.raises(SystemExit) as end:
            main(["batch", *map(str, args)])
        assert end.value.code == 1

    return run


@pytest.fixture
def refused_with(capsys: pytest.CaptureFixture[str]):
    """Runs a command line that must end with exit code 2; returns the lines of the error stream."""

    def run(*args: object) -> list[str]:
        capsys.readouterr()
        with pytest.raises(SystemExit) as end:
            main([str(arg) for arg in args])
        assert end.value.code == 2
        return capsys.readouterr().err.strip().splitlines()

    return run


@pytest.fixture
def refused(refused_with):
    """The same with an error of one line, after lines of progress if it takes long; returns the line."""

    def run(*args: object) -> str:
        lines = [line for line in refused_with(*args) if not re.search(r": [0-9]+ of [0-9]+ after ", line)]
        assert len(lines) == 1, lines
        return lines[0]

    return run

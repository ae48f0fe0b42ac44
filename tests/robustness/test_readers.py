"""Mutated files against every reader, and whether the harness notices what they may not do; the long run is in
`bench robustness`."""

import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from data import SEED

from pps_vision.errors import InputError
from pps_vision.experiments import fuzz_readers
from pps_vision.experiments.fuzz_readers import fuzz, mutate, try_mutants
from pps_vision.experiments.sound_inputs import READERS, Reader

BROKE_A_READER = [  # by the long run
    ("manifest", b"name,left\nfirst,l.mp4\rsecond,r.mp4\n"),
    ("mesh_obj", b"v 0 0\nv 1 0\nv 0 1\nv 1 1\nf 1 2 3\nf 2 3 4\n"),
    ("mesh_obj", b"v 0\nv 1\nv 2\nf 1 2 3\n"),
    ("mesh_obj", b"v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 2 3\nf 1 3 2\nf 2 1 4\nf 2 4 1\n"),
]


def ends(reader: Reader, n: int = 12) -> list[str]:
    return [ended for _, ended in try_mutants(reader, SEED, range(n)) if ended != "start"]


@pytest.mark.parametrize("name", READERS)
def test_a_mutated_file_is_read_or_refused(name: str) -> None:
    assert set(ends(READERS[name])) <= {"read", "refused"}


@pytest.mark.parametrize(("name", "content"), BROKE_A_READER)
def test_what_once_broke_a_reader_is_read_or_refused(name: str, content: bytes, tmp_path: Path) -> None:
    (file,) = READERS[name].write(tmp_path)
    file.write_bytes(content)
    with suppress(InputError):
        READERS[name].read(tmp_path)


def test_a_robot_that_once_broke_its_reader_is_refused(tmp_path: Path) -> None:
    file = next(file for file in READERS["robot"].write(tmp_path) if file.name == "robot.toml")
    file.write_text(file.read_text().replace('"a1", "a2"', "[" * 3000))
    with pytest.raises(InputError, match=r"robot\.toml.* cannot be read as TOML"):
        READERS["robot"].read(tmp_path)


@pytest.mark.parametrize("change", [{"unanswered": np.inf}, {"limits_rad": np.ones((3, 2, 3))}, {"optimality": 1j}])
def test_a_map_that_once_broke_its_reader_is_refused(change: dict[str, Any], tmp_path: Path) -> None:
    (file,) = READERS["map"].write(tmp_path)
    with np.load(file) as archive:
        arrays = {**archive, **change}
    np.savez(file, **arrays)
    with pytest.raises(InputError, match=r"map\.npz: "):
        READERS["map"].read(tmp_path)


def test_mutants_differ_and_come_again_by_their_seed() -> None:
    content = b"stamp 1.5 2.5\nrow 3 4\n" * 9
    made = [mutate(content, np.random.default_rng([SEED, k])) for k in range(50)]
    assert made == [mutate(content, np.random.default_rng([SEED, k])) for k in range(50)]
    assert len(set(made)) > 40


def _fails(folder: Path) -> None:
    raise KeyError("defect")


def _refuses(folder: Path) -> None:
    raise InputError(folder, "no")


def _hangs(folder: Path) -> None:
    time.sleep(5)


def _damages(folder: Path) -> None:
    (folder / "file").write_bytes(b"")


@pytest.mark.parametrize(
    ("defect", "ended"),
    [
        (_fails, "KeyError: 'defect'"),
        (_refuses, "refused"),
        (_hangs, "over 0.2 s"),
        (_damages, "files of the input were changed"),
    ],
)
def test_the_harness_notices(defect: Callable[[Path], None], ended: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuzz_readers, "MOST_SECONDS", 0.2)
    sound = b"sound"

    def write(folder: Path) -> list[Path]:
        (folder / "file").write_bytes(sound)
        return [folder / "file"]

    def read(folder: Path) -> None:
        if (folder / "file").read_bytes() != sound:
            defect(folder)

    assert ended in " ".join(ends(Reader(write, read), 4))  # some mutants may be as the sound file


def test_the_harness_notices_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """The process's peak, told by the system, rises by 900 MB while the second mutant is read."""
    peaks_mb = iter([100, 200, 200, 1100, 1100, 1100])
    usage = type("resource", (), {"RUSAGE_SELF": 0})
    usage.getrusage = staticmethod(lambda _: type("usage", (), {"ru_maxrss": 1024 * next(peaks_mb)}))  # type: ignore[attr-defined]
    monkeypatch.setattr(fuzz_readers, "resource", usage)
    assert [ended.startswith("takes 900 MB") for ended in ends(READERS["gaze"], 3)] == [False, True, False]


def test_a_mutant_that_ends_the_process_costs_itself_only(tmp_path: Path) -> None:
    (tmp_path / "worker.py").write_text(
        "import json, os, sys\n"
        "first, n = map(int, sys.argv[3:])\n"
        "for k in range(first, first + n):\n"
        "    print(json.dumps([k, 'start']), flush=True)\n"
        "    if k == 2: os.kill(os.getpid(), 11)\n"
        "    print(json.dumps([k, 'refused' if k % 2 else 'read']), flush=True)\n"
    )
    found = fuzz("any", 1, 5, (sys.executable, str(tmp_path / "worker.py")))
    assert (found.read, found.refused, found.faults) == (2, 2, ("any 2: ended the process by -11",))

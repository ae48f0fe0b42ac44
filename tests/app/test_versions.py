"""What a result was made with and on."""

import os
import platform
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import scipy

from pps_vision.app import versions


def test_versions_are_those_of_the_packages_themselves() -> None:
    found = versions.versions()
    assert (found["numpy"], found["scipy"], found["python"]) == (
        *(np.__version__, scipy.__version__, platform.python_version()),
    )
    told = versions.machine("abc1234")
    assert {key: told[key] for key in ("numpy", "python", "pps-vision", "commit")} == {
        **{key: found[key] for key in ("numpy", "python", "pps-vision")},
        "commit": "abc1234",
    }
    assert told["processor"].endswith(f", {os.cpu_count()} cores")


@pytest.mark.parametrize(
    ("cpuinfo", "told"),
    [
        ("processor\t: 0\nmodel name\t: One: 3 GHz\nprocessor\t: 1\nmodel name\t: Two\n", "One: 3 GHz"),
        ("processor\t: 0\nBogoMIPS\t: 50\n", "its family"),
        (None, "its family"),
    ],
)
def test_the_processor_is_told_where_the_system_names_it(
    cpuinfo: str | None, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if cpuinfo is not None:
        (tmp_path / "cpuinfo").write_text(cpuinfo)
    monkeypatch.setattr(versions, "Path", lambda _: tmp_path / "cpuinfo")
    monkeypatch.setattr(platform, "processor", lambda: "its family")
    assert versions._processor() == told
    monkeypatch.setattr(platform, "processor", lambda: "")
    assert versions._processor() == (told if cpuinfo and "model" in cpuinfo else platform.machine())


def test_the_commit_is_marked_where_code_differs_from_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a repository of its own, with this project's function."""
    git = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b.c"]
    code = tmp_path / "package" / "app" / "code.py"
    code.parent.mkdir(parents=True)
    code.write_text("x = 1\n")
    monkeypatch.setattr(versions, "__file__", str(code))
    for words in (["init", "-q"], ["add", "."], ["commit", "-qm", "first"]):
        subprocess.run([*git, *words], check=True)
    clean = versions.commit()
    assert len(clean) >= 7
    assert "dirty" not in clean
    (tmp_path / "notes.md").write_text("documents are not code")
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / "test_code.py").write_text("nor are tests")
    assert versions.commit() == clean
    for words in (["add", "."], ["commit", "-qm", "notes and tests"]):
        subprocess.run([*git, *words], check=True)
    assert versions.commit() == clean
    code.write_text("x = 2\n")
    assert versions.commit() == f"{clean}-dirty"
    shutil.rmtree(tmp_path / ".git")
    assert versions.commit() == "unknown"

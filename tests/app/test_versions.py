"""Versions, machine and commit that results name."""

import os
import platform
import shutil
import subprocess
from pathlib import Path

import numpy as np
import scipy

from pps_vision.app import versions


def test_versions_are_those_of_the_packages_themselves() -> None:
    packages = versions.versions()
    expected = {"numpy": np.__version__, "scipy": scipy.__version__, "python": platform.python_version()}
    assert expected.items() <= packages.items()
    machine = versions.machine("abc1234")
    assert machine["commit"] == "abc1234"
    assert all(machine[key] == packages[key] for key in ("numpy", "python", "pps-vision"))
    assert machine["processor"].endswith(f", {os.cpu_count()} cores")


def test_the_commit_is_marked_where_code_differs_from_it(tmp_path: Path, monkeypatch) -> None:
    """In a new repository, with this project's function."""
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

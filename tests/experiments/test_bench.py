"""`bench`: runs, skipped and refused ones, and files."""

import importlib
import json
import re
from pathlib import Path
from typing import Any

import pytest

from pps_vision.app import versions
from pps_vision.errors import InputError
from pps_vision.experiments import bench

FAKE = '''
"""Thirds of a seed.

More of it.
"""
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar
from pps_vision.experiments.charts import bar_chart
from pps_vision.experiments.study import Part, PartsStudy, Study
from pps_vision.experiments.tables import Table

def draw(numbers):
    figure = bar_chart(["a"], {"third": [numbers["third"]]}, "third", 4.0)
    return {"": figure, "other": figure}

def tabulate(numbers):
    values = {"": numbers["third"], "ten_times": 10 * numbers["third"]}
    return {name: Table(["what", "value"], [["third", f"{value:.3g}"]]) for name, value in values.items()}

def measure(study):
    with open("runs.txt", "a") as runs:
        runs.write(f"{study.seed} ")
    return {"third": study.seed / 3, "cells": {"größe": [1, 2 / 3]}}

@dataclass(frozen=True)
class Fake(Study):
    SHORT: ClassVar[Mapping[str, Any]] = {"seed": 9}
    seed: int = 0
    workers: int = 1
    share: float = 1.0
    def run(self):
        return measure(self)
    def chart(self, numbers):
        return draw(numbers)
    def tables(self, numbers):
        return tabulate(numbers)

@dataclass(frozen=True)
class Parts(PartsStudy):
    PARTS: ClassVar[Mapping[str, Part]] = {
        "first": Part(measure, draw, tabulate),
        "plain": Part(measure),
        "no_data": Part(lambda study: {"skipped": "no such folder"}, draw, tabulate),
    }
    seed: int = 0

@dataclass(frozen=True)
class Fails(Fake):
    def run(self):
        return self.nothing
'''


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to run in, where the commit is 1234567 and the studies are `FAKE`'s."""
    (tmp_path / "fake_study.py").write_text(FAKE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    module = importlib.reload(importlib.import_module("fake_study"))
    studies = {"fake": module.Fake, "fake_more": module.Fake, "parts": module.Parts}
    monkeypatch.setattr(bench, "catalogue", lambda: studies)
    set_commit(monkeypatch, "1234567")
    (tmp_path / "docs").mkdir()
    return tmp_path


def set_commit(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setattr(versions, "commit", lambda: name)


def seeds_run(folder: Path) -> str:
    file = folder / "runs.txt"
    return file.read_text() if file.exists() else ""


def result(folder: Path, name: str) -> dict[str, Any]:
    numbers: dict[str, Any] = json.loads((folder / "docs" / "results" / f"{name}.json").read_text())
    return numbers


def test_an_interrupted_run_goes_on_where_it_stopped(folder, monkeypatch, capsys):
    bench.bench(["fake"], {"seed": 1})
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == ["→ docs/figures/fake.png", "→ docs/figures/fake_other.png"]
    assert re.fullmatch(r"→ docs/results/fake\.json \(\d s\)", lines[2])
    bench.bench(["fake"], {"seed": 1})
    assert seeds_run(folder) == "1 "
    skipped = "= docs/results/fake.json (already measured by this commit with these parameters)\n"
    assert capsys.readouterr().out == skipped
    bench.bench(["fake"], {"seed": 1}, again=True)
    bench.bench(["fake"], {"seed": 2})
    assert seeds_run(folder) == "1 1 2 ", "other parameters are another measurement"
    set_commit(monkeypatch, "7654321")
    bench.bench(["fake"], {"seed": 2})
    assert seeds_run(folder) == "1 1 2 2 ", "other code is another measurement"
    (folder / "docs" / "figures" / "fake.png").unlink()
    bench.bench(["fake"], redraw=True)
    assert (folder / "docs" / "figures" / "fake.png").exists()
    assert seeds_run(folder) == "1 1 2 2 ", "redrawing measures nothing"


def test_parts_are_measured_each_for_itself(folder, capsys):
    page = folder / "docs" / "page.md"
    markers = [f"<!-- table: parts_{name} -->\n<!-- end -->\n" for name in ("first", "first_ten_times", "no_data")]
    page.write_text("".join(markers))
    bench.bench(["parts"], {"parts": ("first",), "seed": 3})
    assert list(result(folder, "parts")) == ["study", "first"]
    assert {file.name for file in (folder / "docs" / "figures").iterdir()} == {
        "parts_first.png",
        "parts_first_other.png",
    }
    bench.bench(["parts"], {"parts": ("no_data", "plain"), "seed": 6})
    bench.bench(["parts"], {"seed": 3})
    assert seeds_run(folder) == "3 6 3 ", "the first part was known, the second not with this seed"
    numbers = result(folder, "parts")
    assert list(numbers) == ["study", "first", "plain", "no_data"]
    assert numbers["first"]["parameters"] == {"seed": 3}
    assert numbers["plain"]["third"] == 1.0
    assert "no_data (0 s; skipped: no such folder)" in capsys.readouterr().out
    assert [line for line in page.read_text().splitlines() if "third" in line] == ["| third | 1 |", "| third | 10 |"]
    assert page.read_text().endswith(markers[2]), "a table without its data stays as it is"
    with pytest.raises(InputError, match="--parts second; expected of first, plain, no_data"):
        bench.bench(["parts"], {"parts": ("second",)})


def test_uncommitted_code_never_writes_into_the_documents(folder, monkeypatch):
    set_commit(monkeypatch, "1234567-dirty")
    with pytest.raises(InputError, match="uncommitted"):
        bench.bench(["all"])
    assert seeds_run(folder) == ""
    bench.bench(["fake"], out=folder / "elsewhere")
    bench.bench(["fake"], out=folder / "elsewhere")
    assert seeds_run(folder) == "0 0 ", "uncommitted code is always measured"


def test_a_short_run_leaves_the_documents_alone(folder):
    """Documents with their tables go where the results go."""
    page = "<!-- table: fake -->\n<!-- end -->\n"
    (folder / "docs" / "page.md").write_text(page)
    (folder / "docs" / "plain.md").write_text("no table\n")
    with pytest.raises(InputError, match="short"):
        bench.bench(["all"], short=True)
    bench.bench(["fake"], out=folder / "elsewhere", short=True)
    bench.bench(["fake"], {"seed": 2}, out=folder / "elsewhere", short=True)
    assert seeds_run(folder) == "9 2 "
    assert (folder / "docs" / "page.md").read_text() == page
    assert "| third | 0.667 |" in (folder / "elsewhere" / "page.md").read_text()
    assert not (folder / "elsewhere" / "plain.md").exists()


@pytest.mark.long
def test_a_study_that_fails_stops_no_other(folder, monkeypatch, capsys):
    """Several studies run side by side."""
    module = importlib.import_module("fake_study")
    studies = {"a": module.Fake, "bad": module.Fails, "b": module.Fake, "worse": module.Fails}
    monkeypatch.setattr(bench, "catalogue", lambda: studies)
    with pytest.raises(AttributeError, match="nothing"):
        bench.bench(["all"], {"seed": 3, "workers": 2})
    assert result(folder, "a")["parameters"]["workers"] == 1
    assert sorted(file.name for file in (folder / "docs" / "results").iterdir()) == ["a.json", "b.json"]
    assert result(folder, "b")["third"] == 1.0
    assert re.findall(r"^! .*", capsys.readouterr().out, re.M) == ["! 'Fails' object has no attribute 'nothing'"]


def test_of_all_studies_those_with_an_option_take_it(folder):
    bench.bench(["all"], {"share": 0.5})
    assert result(folder, "fake")["parameters"] == {"seed": 0, "workers": 1, "share": 0.5}
    assert result(folder, "parts")["plain"]["parameters"] == {"seed": 0}


def test_unknown_tables_studies_and_options_are_refused(folder):
    (folder / "docs" / "page.md").write_text("<!-- table: gone -->\n<!-- end -->")
    for names, options, message in ((["fake", "parts"], {}, "gone"), (["fame"], {}, "no study fame")):
        with pytest.raises(InputError, match=message):
            bench.bench(names, options)
    with pytest.raises(InputError, match="takes no n"):
        bench.bench(["fake"], {"n": 3})

"""What `bench` runs, skips and refuses, and what it writes."""

import json
import os
import re
import shutil
import subprocess
from dataclasses import fields, is_dataclass
from pathlib import Path

import pytest

from pps_vision.app import bench, versions
from pps_vision.app.bench import listing
from pps_vision.app.cli import main
from pps_vision.errors import InputError
from pps_vision.experiments import study
from pps_vision.experiments.study import Entry, Study, catalogue, load

KNOWN = catalogue()

FAKE = '''
from dataclasses import dataclass
from pps_vision.experiments.study import Study
from pps_vision.experiments.tables import Table
from pps_vision.experiments.charts import panels, bars

@dataclass(frozen=True)
class Fake(Study):
    """Halves its seed."""
    seed: int = 0
    def run(self):
        with open("runs.txt", "a") as runs:
            runs.write(f"{self.seed} ")
        return {"half": self.seed / 3, "cells": {"größe": [1, 2 / 3]}}
    def chart(self, numbers):
        figure, (axis,) = panels(1)
        bars(axis, ["a"], {"half": [numbers["half"]]}, "half")
        return {"": figure, "other": figure}
    def tables(self, numbers):
        of = {"": numbers["half"], "ten_times": 10 * numbers["half"]}
        return {name: Table(["what", "value"], [["half", f"{value:.3g}"]]) for name, value in of.items()}
'''

READER = """
import json
from dataclasses import dataclass
from pathlib import Path
from pps_vision.experiments.study import Study

@dataclass(frozen=True)
class Reader(Study):
    results: Path = Path("docs/results")
    def run(self):
        return {"read": json.loads((self.results / "fake.json").read_text())["half"]}
"""


@pytest.fixture
def fake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to run in, where the only study is `fake` and the commit is 1234567."""
    (tmp_path / "fake_study.py").write_text(FAKE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(bench, "catalogue", lambda: {"fake": Entry("fake_study", "Fake", "Halves.", {"seed": "0"})})
    commit(monkeypatch, "1234567")
    (tmp_path / "docs").mkdir()
    return tmp_path


def commit(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setattr(versions, "commit", lambda: name)


def runs(folder: Path) -> str:
    file = folder / "runs.txt"
    return file.read_text() if file.exists() else ""


def test_an_interrupted_run_goes_on_where_it_stopped(
    fake: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.bench(["fake"], {"seed": 1})
    written = capsys.readouterr().out.splitlines()
    figures, results = (Path("docs", name) for name in ("figures", "results"))
    assert written[:2] == [f"→ {figures}/fake.png", f"→ {figures}/fake_other.png"]
    assert re.fullmatch(rf"→ {results}/fake\.json \(\d s\)", written[2])
    bench.bench(["all"], {"seed": 1})
    assert runs(fake) == "1 "
    known = f"= {results}/fake.json (already measured by this commit with these parameters)\n"
    assert capsys.readouterr().out == known
    bench.bench(["fake"], {"seed": 1}, again=True)
    bench.bench(["fake"], {"seed": 2})
    assert runs(fake) == "1 1 2 ", "other parameters are another measurement"
    commit(monkeypatch, "7654321")
    bench.bench(["fake"], {"seed": 2})
    assert runs(fake) == "1 1 2 2 ", "other code is another measurement"
    (fake / "docs" / "results" / "fake.json").unlink()
    bench.bench(["fake"], {"seed": 2})
    assert runs(fake) == "1 1 2 2 2 "


def test_uncommitted_code_never_writes_into_the_documents(fake: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    commit(monkeypatch, "1234567-dirty")
    with pytest.raises(InputError, match="uncommitted"):
        bench.bench(["all"])
    assert runs(fake) == ""
    bench.bench(["all"], out=fake / "elsewhere")
    bench.bench(["all"], out=fake / "elsewhere")
    assert runs(fake) == "0 0 ", "uncommitted code is always measured"


def test_a_short_run_has_the_smallest_parameters_and_leaves_the_documents_alone(
    fake: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Documents with their tables go where the results go."""
    monkeypatch.setattr(study, "SHORT", {"": {"seed": 6, "n": 1}, "fake": {"seed": 9}, "other": {"seed": 3}})
    page, empty = "<!-- table: fake -->\n<!-- end -->\n", "no table\n"
    (fake / "docs" / "page.md").write_text(page)
    (fake / "docs" / "plain.md").write_text(empty)
    with pytest.raises(InputError, match="short"):
        bench.bench(["all"], short=True)
    bench.bench(["all"], out=fake / "elsewhere", short=True)
    bench.bench(["all"], {"seed": 2}, out=fake / "elsewhere", short=True)
    assert runs(fake) == "9 2 "
    assert (fake / "docs" / "page.md").read_text() == page
    assert "| half | 0.667 |" in (fake / "elsewhere" / "page.md").read_text()
    assert not (fake / "elsewhere" / "plain.md").exists()


def test_what_reads_other_results_runs_last_and_always(fake: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the folder that the others write to; they may have changed since."""
    (fake / "a_study.py").write_text(READER)
    fields = {"results": "Path('docs/results')"}
    entries = {
        "a": Entry("a_study", "Reader", "Reads.", fields),
        "fake": Entry("fake_study", "Fake", "", {"seed": "0"}),
    }
    monkeypatch.setattr(bench, "catalogue", lambda: entries)
    for seed in (3, 6, 6):
        bench.bench(["all"], {"seed": seed}, out=fake / "elsewhere")
        assert json.loads((fake / "elsewhere" / "results" / "a.json").read_text())["read"] == seed / 3
    assert runs(fake) == "3 6 "


def test_studies_run_at_once_and_one_that_fails_stops_no_other(
    fake: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Those that took longest come first, those of unknown time before them; each result says how long it took."""
    (fake / "worse_study.py").write_text(FAKE.replace("runs.write", "self.write").replace("Fake", "Worse"))
    (fake / "bad_study.py").write_text(FAKE.replace("runs.write", "seed.write").replace("Fake", "Bad"))
    fields = {"seed": "0"}
    entries = {
        "a": Entry("fake_study", "Fake", "", fields),
        "bad": Entry("bad_study", "Bad", "", fields),
        "b": Entry("fake_study", "Fake", "", fields),
        "worse": Entry("worse_study", "Worse", "", fields),
    }
    monkeypatch.setattr(bench, "catalogue", lambda: entries)
    with pytest.raises(NameError, match="seed"):
        bench.bench(["all"], {"seed": 3, "workers": 2})
    results = fake / "docs" / "results"
    assert sorted(file.name for file in results.iterdir()) == ["a.json", "b.json"]
    found = json.loads((results / "b.json").read_text())
    assert (found["half"], found["parameters"]) == (1.0, {"seed": 3})
    assert 0 < found["processor_min"] < 1
    assert re.findall(r"^! .*", capsys.readouterr().out, re.M) == ["! 'Worse' object has no attribute 'write'"]
    for name, minutes in (("a", 1.0), ("b", 2.0)):
        (results / f"{name}.json").write_text(json.dumps({"processor_min": minutes}))
    done = []
    monkeypatch.setattr(bench, "_measure", lambda name, *rest: done.append(name))
    bench.bench(["all"])
    assert done == ["bad", "worse", "b", "a"]


@pytest.mark.parametrize(("name", "entry"), KNOWN.items(), ids=list(KNOWN))
def test_parameters_below_the_least_are_refused_by_every_study(name: str, entry: Entry) -> None:
    least = {field: 0 for field, default in entry.fields.items() if default.isdigit() and field != "seed"}
    others = {"seed": -1, "share": 0.0, "seconds": 0.09}
    least |= {field: value for field, value in others.items() if field in entry.fields}
    for field, value in least.items():
        with pytest.raises(InputError, match=f"bench {name}: --{field} {value}; expected at least"):
            load(entry)(**{field: value})
    load(entry)(**study.short_parameters(name, entry))


def test_short_parameters_are_of_studies_that_have_them() -> None:
    known = catalogue()
    for name, given in study.SHORT.items():
        of = set().union(*(entry.fields for entry in known.values())) if name == "" else set(known[name].fields)
        assert set(given) <= of, name


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


def test_results_are_compact_and_documents_filled(fake: Path) -> None:
    document = fake / "docs" / "page.md"
    document.write_text("before\n<!-- table: fake -->\nold\n<!-- end -->\nafter\n")
    (fake / "README.md").write_text("<!-- table: fake -->\n<!-- end -->\n")
    bench.bench(["fake"], {"seed": 1})
    lines = (fake / "docs" / "results" / "fake.json").read_text().splitlines()
    assert '"half": 0.33333,' in [line.strip() for line in lines]
    assert '"cells": {"größe":[1,0.66667]}' in [line.strip() for line in lines]
    numbers = json.loads("".join(lines))
    assert (numbers["study"], numbers["parameters"]) == ("fake", {"seed": 1})
    assert {file.name for file in (fake / "docs" / "figures").iterdir()} == {"fake.png", "fake_other.png"}
    table = "<!-- table: fake -->\n| what | value |\n| --- | ---: |\n| half | 0.333 |\n<!-- end -->\n"
    assert document.read_text() == f"before\n{table}after\n"
    assert (fake / "README.md").read_text() == table


def test_a_table_is_of_the_study_with_the_longest_name_that_it_begins_with(
    fake: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = Entry("fake_study", "Fake", "", {"seed": "0"})
    monkeypatch.setattr(bench, "catalogue", lambda: {"fake": one, "fake_more": one})
    page = fake / "docs" / "page.md"
    tables = ("fake_ten_times", "fake_more", "fake_more_ten_times")
    page.write_text("".join(f"<!-- table: {name} -->\n<!-- end -->\n" for name in tables))
    bench.bench(["fake"], {"seed": 1})
    assert [line for line in page.read_text().splitlines() if "half" in line] == ["| half | 3.33 |"]
    bench.bench(["fake_more"], {"seed": 2})
    values = [line for line in page.read_text().splitlines() if "half" in line]
    assert values == ["| half | 3.33 |", "| half | 0.667 |", "| half | 6.67 |"]


def test_a_group_is_of_the_studies_whose_names_begin_with_it(fake: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = Entry("fake_study", "Fake", "", {"seed": "0"})
    names = ("pps_a", "ppsx", "pps_b", "reach_a", "reach_a_b")
    monkeypatch.setattr(bench, "catalogue", lambda: dict.fromkeys(names, one))
    done: list[str] = []
    monkeypatch.setattr(bench, "_measure", lambda name, *rest: done.append(name))
    for asked, expected in ((["pps"], {"pps_a", "pps_b"}), (["reach_a"], {"reach_a"}), (["pps_b", "ppsx"], None)):
        done.clear()
        bench.bench(asked)
        assert set(done) == (expected or set(asked))
    assert bench.listing().startswith("pps_a: \n    seed = 0\nppsx: \n")
    assert bench.listing().count("\n") == 2 * len(names) - 1


def test_a_study_alone_runs_in_this_process_and_has_the_workers_for_itself(
    fake: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = FAKE.replace("seed: int = 0", "workers: int = 1").replace("self.seed", "self.workers")
    (fake / "own_study.py").write_text(text.replace('runs.write(f"', "runs.write(f\"{__import__('os').getpid()}:"))
    monkeypatch.setattr(bench, "catalogue", lambda: {"own": Entry("own_study", "Fake", "", {"workers": "1"})})
    bench.bench(["own"])
    bench.bench(["own"], {"workers": 3})
    assert runs(fake) == f"{os.getpid()}:1 {os.getpid()}:3 "
    own, other = Entry("own_study", "Fake", "", {"workers": "1"}), Entry("fake_study", "Fake", "", {"seed": "0"})
    monkeypatch.setattr(bench, "catalogue", lambda: {"own": own, "other": other})
    asked: list[tuple[dict[str, Study], int]] = []
    monkeypatch.setattr(bench, "_measure_all", lambda studies, *_: asked.append((studies, _[-1])))
    bench.bench(["own", "other"], {"workers": 3})
    ((together, workers), (after, alone)) = asked
    assert (together["own"].workers, sorted(together), workers) == (1, ["other", "own"], 3)  # type: ignore[attr-defined]
    assert (after, alone) == ({}, 1)  # those of other studies' results


def test_processor_time_is_of_the_run_in_minutes_and_counts_every_process(
    fake: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert bench._processor_s() == pytest.approx(sum(os.times()[:4]), abs=0.1)
    seconds = iter([600.0, 609.0])
    monkeypatch.setattr(bench, "_processor_s", lambda: next(seconds))
    bench.bench(["fake"], {"seed": 1})
    assert json.loads((fake / "docs" / "results" / "fake.json").read_text())["processor_min"] == 0.15


def test_redraw_measures_nothing(fake: Path) -> None:
    bench.bench(["fake"], {"seed": 1})
    (fake / "docs" / "figures" / "fake.png").unlink()
    bench.bench(["fake"], redraw=True)
    assert runs(fake) == "1 "
    assert (fake / "docs" / "figures" / "fake.png").exists()


@pytest.mark.parametrize(
    ("document", "named"),
    [("<!-- table: gone -->\n<!-- end -->", "gone"), ("<!-- table: fake_gone -->\n<!-- end -->", "gone")],
)
def test_a_table_that_no_study_makes_is_refused(fake: Path, document: str, named: str) -> None:
    (fake / "docs" / "page.md").write_text(document)
    with pytest.raises(InputError, match=named):
        bench.bench(["fake"])


def test_unknown_studies_and_options_are_refused(fake: Path) -> None:
    with pytest.raises(InputError, match="no study fame"):
        bench.bench(["fame"])
    with pytest.raises(InputError, match="takes no n"):
        bench.bench(["fake"], {"n": 3})


def test_every_study_is_a_dataclass_with_the_listed_parameters(capsys: pytest.CaptureFixture[str]) -> None:
    """The catalogue reads files; the classes agree with what it says."""
    main(["bench"])
    shown = capsys.readouterr().out
    assert shown.strip() == listing()
    found = catalogue()
    assert {"tracking", "pipeline", "loop", "pps_monte_carlo", "reach_solvers"} <= set(found)
    for name, entry in found.items():
        cls = load(entry)
        assert issubclass(cls, Study)
        assert is_dataclass(cls)
        assert [field.name for field in fields(cls)] == list(entry.fields), name
        assert entry.summary, name
        cls()  # every field has a default


def test_without_options_studies_run_in_full_into_the_documents(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr("pps_vision.app.bench.bench", lambda *words, **options: asked.append((words, options)))
    main(["bench", "filter"])
    main(["bench", "filter", "--n", "3", "--short", "--again", "--redraw", "--out", "elsewhere"])
    plain = {"again": False, "redraw": False, "short": False}
    assert [(list(words[0]), *words[1:], options) for words, options in asked] == [
        (["filter"], {}, Path("docs"), plain),
        (["filter"], {"n": 3}, Path("elsewhere"), dict.fromkeys(plain, True)),
    ]


def test_without_the_data_the_studies_say_so_and_the_tables_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(Path(__file__).parents[2])
    words = ["--short", "--data", str(tmp_path / "none"), "--out", str(tmp_path / "out")]
    main(["bench", "pps_real_trials", "claims", *words])
    said = capsys.readouterr().out
    assert f"skipped: no {tmp_path / 'none'}" in said
    assert json.loads((tmp_path / "out" / "results" / "claims.json").read_text())["claims"] == []
    written, before = (folder / "peripersonal_space.md" for folder in (tmp_path / "out", Path("docs")))
    assert written.read_text() == before.read_text()

"""Outputs appear whole or not at all."""

import os
from pathlib import Path

import pytest

from pps_vision.errors import InputError
from pps_vision.recordings.outputs import whole_file, whole_folder


def test_a_folder_appears_when_the_block_ends(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "out"
    with whole_folder(target) as folder:
        (folder / "a").write_text("1")
        assert not target.exists()
    assert [p.name for p in target.iterdir()] == ["a"]
    assert [p.name for p in target.parent.iterdir()] == ["out"]


def test_a_failed_folder_leaves_nothing(tmp_path: Path) -> None:
    def interrupted() -> None:
        with whole_folder(tmp_path / "out") as folder:
            (folder / "a").write_text("1")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []


def test_an_empty_folder_is_taken_and_a_full_one_refused(tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.mkdir()
    with whole_folder(target) as folder:
        (folder / "mine").write_text("1")
    with pytest.raises(InputError, match="already holds mine"), whole_folder(target):
        pass
    assert (target / "mine").read_text() == "1"


def test_a_previous_run_is_replaced_and_everything_else_stays(tmp_path: Path) -> None:
    target = tmp_path / "out"
    names = ("report.html", "overlay.webm")
    with whole_folder(target, names) as folder:
        (folder / "report.html").write_text("old")
        (folder / "overlay.webm").write_text("of the old run")
    (target / "thesis.txt").write_text("mine")
    with whole_folder(target, names) as folder:
        (folder / "report.html").write_text("new")
    assert {p.name: p.read_text() for p in target.iterdir()} == {"report.html": "new", "thesis.txt": "mine"}
    assert [p.name for p in tmp_path.iterdir()] == ["out"]
    with pytest.raises(InputError, match=r"already holds report\.html"), whole_folder(target):
        pass


def test_an_existing_folder_stays_the_same_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "out"
    target.mkdir()
    monkeypatch.chdir(target)  # as a shell would
    before = target.stat().st_ino
    for results in ((), ("a",)):
        with whole_folder(Path(), results) as folder:
            (folder / "a").write_text("1")
            assert [p.name for p in tmp_path.iterdir()] == ["out"]
        assert os.listdir() == ["a"]
    with pytest.raises(ZeroDivisionError), whole_folder(target, ("a",)) as folder:
        (folder / "a").write_text(f"broken {1 / 0}")
    assert (os.listdir(), Path("a").read_text(), target.stat().st_ino) == (["a"], "1", before)


def test_folders_are_moved_into_an_empty_one(tmp_path: Path) -> None:
    with whole_folder(tmp_path) as folder:
        (folder / "cam").mkdir()
        (folder / "cam" / "a").write_text("1")
    assert [p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*")] == ["cam", "cam/a"]


def test_a_folder_in_the_place_of_a_result_is_refused_on_entering(tmp_path: Path) -> None:
    (tmp_path / "b.csv" / "mine").mkdir(parents=True)
    with pytest.raises(InputError, match=r"b\.csv: is a folder"), whole_folder(tmp_path, ("a.csv", "b.csv")):
        pytest.fail("entered")
    assert [p.name for p in tmp_path.rglob("*")] == ["b.csv", "mine"]


def test_a_failed_second_run_keeps_the_first(tmp_path: Path) -> None:
    target = tmp_path / "out"
    with whole_folder(target) as folder:
        (folder / "a").write_text("old")
    with pytest.raises(RuntimeError), whole_folder(target, results=("a",)):
        raise RuntimeError
    assert (target / "a").read_text() == "old"


@pytest.mark.parametrize("whole", [whole_folder, whole_file])
def test_an_unwritable_place_is_refused_on_entering(tmp_path: Path, whole) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"), whole(tmp_path / "file" / "out"):
        pytest.fail("entered")


def test_a_file_where_a_folder_is_asked_for_and_the_reverse(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file"), whole_folder(tmp_path / "file"):
        pass
    with pytest.raises(InputError, match="is a folder"), whole_file(tmp_path):
        pass


def test_a_file_appears_when_the_block_ends_and_keeps_its_suffix(tmp_path: Path) -> None:
    target = tmp_path / "boxes.csv"
    target.write_text("old")
    with whole_file(target) as partial:
        assert partial.suffix == ".csv"
        partial.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    with pytest.raises(ZeroDivisionError), whole_file(target) as partial:
        partial.write_text(f"broken {1 / 0}")
    assert target.read_text() == "new"
    assert [p.name for p in tmp_path.iterdir()] == ["boxes.csv"]

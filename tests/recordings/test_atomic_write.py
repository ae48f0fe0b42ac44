"""Outputs appear whole or not at all."""

import json
import os
from contextlib import suppress
from pathlib import Path

import pytest

from pps_vision.errors import InputError
from pps_vision.recordings.atomic_write import locked_folder, remove_unfinished, whole_file, whole_folder, write_json


def test_a_folder_appears_when_the_block_ends(tmp_path):
    target = tmp_path / "deep" / "out"
    with whole_folder(target) as folder:
        (folder / "a").write_text("1")
        assert not target.exists()
    assert [p.name for p in target.iterdir()] == ["a"]
    assert [p.name for p in target.parent.iterdir()] == ["out"]


def test_an_existing_folder_stays_the_same_folder(tmp_path, monkeypatch):
    target = tmp_path / "out"
    target.mkdir()
    monkeypatch.chdir(target)  # as a shell would
    inode = target.stat().st_ino
    with pytest.raises(ZeroDivisionError), whole_folder(Path()) as folder:
        (folder / "a").write_text(f"broken {1 / 0}")
    assert os.listdir() == []
    with whole_folder(Path()) as folder:
        (folder / "a").write_text("1")
        assert [p.name for p in tmp_path.iterdir()] == ["out"]
    assert (os.listdir(), target.stat().st_ino) == (["a"], inode)


@pytest.mark.parametrize("whole", [whole_folder, whole_file])
def test_an_unwritable_place_is_refused_on_entering(tmp_path, whole):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"), whole(tmp_path / "file" / "out"):
        pytest.fail("entered")


def test_a_file_where_a_folder_is_asked_for_and_the_reverse(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is no folder"), whole_folder(tmp_path / "file"):
        pass
    with pytest.raises(InputError, match="is a folder"), whole_file(tmp_path):
        pass


def test_a_file_appears_when_the_block_ends_and_keeps_its_suffix(tmp_path):
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


@pytest.mark.parametrize("link", ["same", "symbolic", "hard"])
def test_what_is_read_is_not_written_over(tmp_path, link):
    source = tmp_path / "source.npz"
    out = tmp_path / "out.npz"
    source.write_text("mine")
    match link:
        case "same":
            out = source
        case "symbolic":
            out.symlink_to(source)
        case "hard":
            out.hardlink_to(source)
    with pytest.raises(InputError, match=r"belongs to .*source\.npz, which is read"), whole_file(out, [None, source]):
        pytest.fail("entered")
    assert source.read_text() == "mine"


def test_folders_made_for_an_output_that_failed_are_removed(tmp_path):
    with pytest.raises(ZeroDivisionError), whole_file(tmp_path / "deep" / "er" / "a.csv") as partial:
        partial.write_text(f"broken {1 / 0}")
    assert list(tmp_path.iterdir()) == []


def test_a_locked_folder_is_made_and_held_by_one_until_the_block_ends(tmp_path):
    folder = tmp_path / "deep" / "out"
    for _ in range(2):
        with locked_folder(folder):
            with pytest.raises(InputError, match="out: another run is writing to it"), locked_folder(folder):
                pytest.fail("entered")
            (folder / "a").write_text("1")
        assert os.listdir(folder) == ["a"]
    with pytest.raises(InputError, match="a: is no folder"), locked_folder(folder / "a"):
        pytest.fail("entered")
    with pytest.raises(InputError, match="b: cannot be written: Not a directory"), locked_folder(folder / "a" / "b"):
        pytest.fail("entered")


def test_a_signal_removes_what_this_process_has_begun_and_nothing_else(tmp_path):
    with whole_file(tmp_path / "done.csv") as partial:
        partial.write_text("1")
    (tmp_path / ".done.csv.lock").write_text("of another process, by now")
    with suppress(OSError), whole_folder(tmp_path / "out") as folder:
        (folder / "a").write_text("1")
        remove_unfinished()
        assert sorted(os.listdir(tmp_path)) == [".done.csv.lock", "done.csv"]
    assert sorted(os.listdir(tmp_path)) == [".done.csv.lock", "done.csv"]


def test_a_file_of_a_folder_that_is_read_is_not_written_over_but_a_new_one_may_lie_there(tmp_path):
    log = tmp_path / "rec" / "head" / "data.log"
    log.parent.mkdir(parents=True)
    log.write_text("mine")
    with pytest.raises(InputError, match="which is read"), whole_file(log, [tmp_path / "rec"]):
        pytest.fail("entered")
    with whole_file(tmp_path / "rec" / "boxes.csv", [tmp_path / "rec"]) as partial:
        partial.write_text("new")
    assert sorted(p.name for p in (tmp_path / "rec").iterdir()) == ["boxes.csv", "head"]


def test_a_fifo_and_a_device_are_refused(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    for place in (tmp_path / "fifo", Path("/dev/null")):
        with pytest.raises(InputError, match="is no regular file"), whole_file(place):
            pytest.fail("entered")
        with pytest.raises(InputError, match="is no folder"), whole_folder(place):
            pytest.fail("entered")
    assert (tmp_path / "fifo").is_fifo()


@pytest.mark.parametrize("whole", [whole_folder, whole_file])
def test_a_second_run_is_refused_before_it_works_and_the_first_finishes(tmp_path, whole):
    target = tmp_path / "out"
    with whole(target) as partial:
        with pytest.raises(InputError, match="another run is writing to it"), whole(target):
            pytest.fail("entered")
        with whole(tmp_path / "other") as second:  # another output is no matter
            (second.mkdir if whole is whole_folder and not second.exists() else second.touch)()
        (partial / "a" if whole is whole_folder else partial).write_text("1")
    assert (target / "a" if whole is whole_folder else target).read_text() == "1"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["other", "out"]


@pytest.mark.parametrize("exists", [False, True])
@pytest.mark.parametrize("whole", [whole_folder, whole_file])
def test_what_a_killed_run_has_left_is_removed_and_no_ones_else(tmp_path, whole, exists):
    """Killed runs of this output, of one whose name begins the same, and of an earlier version (with its number)."""
    target = tmp_path / "out"
    place = target if whole is whole_folder and exists else tmp_path
    place.mkdir(exist_ok=True)
    for name in (".out.12ab34cd.partial", f".out.{os.getpid()}.partial", ".out.b.12ab34cd.partial"):
        (place / name / "cam").mkdir(parents=True)
    (place / ".out.lock").touch()
    partial_name = ".out.b.12ab34cd.partial"
    if place == target:
        (place / partial_name / "cam").rmdir()
        (place / partial_name).rmdir()
    with whole(target) as partial:
        (partial / "a" if whole is whole_folder else partial).write_text("1")
    content = sorted(p.name for p in tmp_path.iterdir())
    assert content == (["out"] if place == target else [partial_name, "out"])


def test_what_appears_meanwhile_is_kept_and_so_is_the_work(tmp_path):
    def write_while_another_program_does() -> None:
        with whole_folder(tmp_path / "out") as folder:
            (folder / "a").write_text("1")
            (tmp_path / "out" / "mine").mkdir(parents=True)

    with pytest.raises(InputError, match="the output is kept in ") as error:
        write_while_another_program_does()
    (partial_name,) = (p for p in tmp_path.iterdir() if p.name != "out")
    assert str(partial_name) in str(error.value)
    assert (partial_name / "a").read_text() == "1"
    assert (tmp_path / "out" / "mine").is_dir()


def test_json_holds_the_name_of_a_file_that_is_not_utf8(tmp_path):
    name = os.fsdecode(b"caf\xe9")
    write_json(tmp_path / "a.json", {"source": name, "map": Path(name)})
    content = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert content == {"source": name, "map": name}

"""`learn` and `show`, and touches beside frames."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from learning.pps.memory import load_memory, save_memory
from pps_vision.app.cli import main
from pps_vision.recordings.taxels_ini import PartMap, write_taxels


@pytest.fixture(scope="module")
def memory_file(approach: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("learned") / "memory.npz"
    main(["learn", str(approach), "--out", str(out)])
    return out


def test_the_touched_taxel_learns_positives_and_the_others_negatives(memory_file):
    memory = load_memory(memory_file)
    positive, negative = memory.samples.T
    touched = memory.taxel_ids.index("left_forearm:3")
    assert positive[touched] > 5
    assert negative[touched] == 0
    other_parts = [not name.startswith("left_forearm") for name in memory.taxel_ids]
    assert positive[other_parts].sum() == 0
    assert (negative > 0).any(), "some inner taxel was near and not touched"


def test_learning_goes_on_from_an_earlier_memory(memory_file, approach, tmp_path):
    main(["learn", str(approach), "--into", str(memory_file), "--out", str(tmp_path / "twice.npz")])
    np.testing.assert_array_equal(load_memory(tmp_path / "twice.npz").counts, 2 * load_memory(memory_file).counts)


def test_one_bad_recording_does_not_stop_the_others(memory_file, approach, tmp_path, capsys):
    main(["learn", str(tmp_path / "gone"), str(approach), "--out", str(tmp_path / "m.npz")])
    printed = capsys.readouterr()
    assert "gone" in printed.err
    assert re.search(r": [1-9]\d* samples learned, 0 problems skipped", printed.out)
    assert printed.out.endswith(f"1 of 2 recordings learned → {tmp_path / 'm.npz'}\n")
    np.testing.assert_array_equal(load_memory(tmp_path / "m.npz").counts, load_memory(memory_file).counts)


def test_the_robots_own_skin_events_teach_the_same(memory_file, approach, tmp_path, capsys):
    """The same touches as contacts of physical taxels: number 2n and 2n + 1 belong to virtual taxel n."""
    rec = tmp_path / "rec"
    shutil.copytree(approach, rec)
    log = next(rec.rglob("skin/data.log"))
    rows = []
    for index, stamp, *names in (row.split() for row in log.read_text().splitlines()):
        assert all(name.startswith("left_forearm:") for name in names)
        physical = " ".join(str(2 * int(name.partition(":")[2]) + 1) for name in names)
        contact = f"((0 3 4 2) {5 * '(0.0 0.0 0.0) '} ({physical}) 10.0)" if names else ""
        rows.append(f"{index} {stamp} {contact}\n")
    log.write_text("".join(rows))
    taxels = tmp_path / "taxels.ini"
    mapping = tuple(n // 2 for n in range(800))
    write_taxels(taxels, [PartMap("l_forearm", (-0.1, 0.2), (8, 1), mapping, {3: np.zeros((8, 1, 2), np.int64)})])
    main(["learn", str(rec), "--taxels", str(taxels), "--out", str(tmp_path / "m.npz")])
    np.testing.assert_array_equal(load_memory(tmp_path / "m.npz").counts, load_memory(memory_file).counts)
    main(["learn", str(rec), "--out", str(tmp_path / "none.npz")])
    assert "skin/data.log: the robot's contacts; expected --taxels" in capsys.readouterr().err
    assert not load_memory(tmp_path / "none.npz").counts.any()


def test_show_draws_a_picture(memory_file, tmp_path, capsys):
    memory = load_memory(memory_file)
    stimulated = np.flatnonzero(memory.samples.any(axis=1))
    counts = memory.counts.copy()
    counts[stimulated[2:]] = 0
    save_memory(tmp_path / "two.npz", replace(memory, counts=counts))
    main(["show", str(tmp_path / "two.npz"), "--out", str(tmp_path / "landscape.png")])
    assert f"2 of {len(memory.taxel_ids)} taxels were stimulated" in capsys.readouterr().out
    picture = matplotlib.image.imread(tmp_path / "landscape.png")
    assert picture.shape[0] > 200
    assert len(np.unique(picture.reshape(-1, picture.shape[-1]), axis=0)) > 100

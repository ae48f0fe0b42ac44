"""`pps-vision convert-taxels`: what goes over to the robot and back, and what cannot."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from learning.pps.memory import PROBABILITY, MemoryParams, PPSMemory, load_memory, save_memory
from pps_vision.app.cli import main
from pps_vision.recordings.taxels_ini import read_taxels
from pps_vision.robot.skin import icub_skin

SKIN = icub_skin(("left_forearm", "right_palm"))
LIKE = """[l_forearm]
modality 1D
size 384
nTaxels 0
ext (0.0 1.0)
binsNum (1 1)
Mapping ({forearm})
[r_hand]
modality 1D
size 192
nTaxels 0
ext (0.0 1.0)
binsNum (1 1)
Mapping ({palm})
"""


@pytest.fixture
def like(tmp_path: Path) -> Path:
    """A robot's map that has learned nothing; twelve physical taxels to a virtual one on the forearm."""
    forearm = " ".join(str(12 * (i // 12) + 3) for i in range(384))
    palm = " ".join(str([-1, 101, 103, 118, 137][i // 40]) for i in range(192))
    file = tmp_path / "robot.ini"
    file.write_text(LIKE.format(forearm=forearm, palm=palm))
    return file


def learned(params: MemoryParams | None = None) -> PPSMemory:
    memory = PPSMemory.empty(SKIN, params or MemoryParams())
    return replace(memory, counts=np.random.default_rng(1).integers(0, 2**40, memory.counts.shape))


def convert(*args: object) -> None:
    main(["convert-taxels", *map(str, args)])


@pytest.mark.parametrize(
    "params",
    [MemoryParams(ttc_range_s=(0.0, 1.2)), MemoryParams((-0.05, 0.45), (-np.inf, np.inf), (20, 1))],
    ids=["2D", "1D"],
)
def test_a_memory_goes_to_the_robot_and_back(params, like, tmp_path, capsys):
    memory = learned(params)
    save_memory(tmp_path / "m.npz", memory)
    convert(tmp_path / "m.npz", tmp_path / "taxels.ini", "--like", like)
    forearm, palm = read_taxels(tmp_path / "taxels.ini")
    assert (forearm.name, palm.name, palm.bins) == ("l_forearm", "r_hand", params.bins)
    assert forearm.mapping == read_taxels(like)[0].mapping
    assert palm.extent == (*params.distance_range_m, *((0.0, 1.2) if params.bins[1] == 4 else ()))
    np.testing.assert_array_equal(forearm.counts[27], memory.counts[0])
    np.testing.assert_array_equal(palm.counts[137], memory.counts[-1])
    convert(tmp_path / "taxels.ini", tmp_path / "back.npz")
    back = load_memory(tmp_path / "back.npz")
    assert capsys.readouterr().out.splitlines() == [  # nothing is left out
        f"{len(SKIN.taxel_ids)} taxels on l_forearm, r_hand → {tmp_path / 'taxels.ini'}",
        f"{len(SKIN.taxel_ids)} taxels on left_forearm, right_palm → {tmp_path / 'back.npz'}",
    ]
    assert (back.taxel_ids, back.params) == (memory.taxel_ids, memory.params)
    np.testing.assert_array_equal(back.counts, memory.counts)
    np.testing.assert_array_equal(back.part_index, memory.part_index)


def test_a_robots_map_is_put_on_our_skin(like, tmp_path, capsys):
    """It has a taxel that our skin lacks (63), and lacks our taxels that were never touched there."""
    text = like.read_text().replace("nTaxels 0", "nTaxels 2", 1)
    text = text.replace("[r_hand]", "63 (5) (6)\n27 (7) (8)\n[r_hand]")
    like.write_text(text)
    convert(like, tmp_path / "m.npz", "--own-skin")
    memory = load_memory(tmp_path / "m.npz")
    assert memory.taxel_ids == icub_skin().taxel_ids
    assert memory.counts.sum() == 15
    np.testing.assert_array_equal(memory.counts[icub_skin().index("left_forearm:27"), 0, 0], [7, 8])
    said = capsys.readouterr().out
    assert "1 of 2 taxels are on this skin, the others left out; 31 of its stay empty" in said
    assert "32 taxels on left_forearm" in said


def test_parts_of_different_form_are_converted_one_by_one(refused, like, tmp_path):
    text = like.read_text()
    like.write_text(text.replace("ext (0.0 1.0)", "ext (0.0 0.5)", 1))
    line = refused("convert-taxels", like, tmp_path / "m.npz")
    assert "robot.ini: l_forearm has ext (0.0, 0.5), bins (1, 1), r_hand has ext (0.0, 1.0)" in line
    convert(like, tmp_path / "m.npz", "--parts", "r_hand")
    assert load_memory(tmp_path / "m.npz").params.distance_range_m == (0.0, 1.0)
    assert "no l_foot; expected one of l_forearm, r_hand" in refused(
        "convert-taxels", like, tmp_path / "n.npz", "--parts", "l_foot"
    )


@pytest.mark.parametrize(
    ("memory", "says"),
    [
        (replace(learned(), counts=learned().counts + 0.5), "m.npz: has fractions of samples"),
        (learned(MemoryParams(ttc_range_s=(0.0, np.inf), bins=(8, 1))), "TTC (0.0, inf) s; expected finite ones"),
        (learned(MemoryParams((-np.inf, np.inf), bins=(1, 4))), "ranges D (-inf, inf) m"),
        (
            PPSMemory.constant(icub_skin()),
            "robot.ini: has no r_forearm, on which taxel right_forearm:27 is",
        ),
        (PPSMemory.empty(icub_skin(("left_palm",))), "robot.ini: has none of the taxels of"),
        (replace(learned(), taxel_ids=("left_forearm:28", *learned().taxel_ids[1:])), "[l_forearm] knows no taxel 28"),
    ],
)
def test_what_cannot_be_said_in_the_robots_form(refused, memory, says, like, tmp_path):
    save_memory(tmp_path / "m.npz", memory)
    assert says in refused("convert-taxels", tmp_path / "m.npz", tmp_path / "t.ini", "--like", like)
    assert not (tmp_path / "t.ini").exists()


def test_the_counts_of_all_paths_are_written_together(like, tmp_path):
    """Of a memory that knows the predicted miss distance, for which the robot's form has no place."""
    memory = learned(PROBABILITY)
    save_memory(tmp_path / "m.npz", memory)
    convert(tmp_path / "m.npz", tmp_path / "taxels.ini", "--like", like)
    forearm, _ = read_taxels(tmp_path / "taxels.ini")
    np.testing.assert_array_equal(forearm.counts[27], memory.counts[0].sum(axis=2))


def test_untouched_taxels_that_the_robot_lacks_are_left_out(like, tmp_path, capsys):
    whole = PPSMemory.empty(icub_skin(), MemoryParams())
    mapped = [name.startswith(("left_forearm", "right_palm")) for name in whole.taxel_ids]
    counts = whole.counts + np.reshape(mapped, (-1, 1, 1, 1))
    save_memory(tmp_path / "m.npz", replace(whole, counts=counts, params=MemoryParams(sigma_bins=0.75)))
    convert(tmp_path / "m.npz", tmp_path / "taxels.ini", "--like", like)
    assert [len(part.counts) for part in read_taxels(tmp_path / "taxels.ini")] == [12, 4]
    said = capsys.readouterr().out
    assert f"left out: {32 - sum(mapped)} untouched taxels that {like} does not know" in said
    assert "not carried: a window 0.75 bins wide" in said


def test_which_way_is_told_by_the_suffixes(refused, like, tmp_path):
    save_memory(tmp_path / "m.npz", learned())
    for pair in (("m.npz", "n.npz"), ("robot.ini", "t.ini"), ("m.npz", "t.txt")):
        assert "expected a .npz and a .ini" in refused("convert-taxels", *(tmp_path / name for name in pair))
    assert "expected --like" in refused("convert-taxels", tmp_path / "m.npz", tmp_path / "t.ini")
    assert "only where a .npz is converted" in refused("convert-taxels", like, tmp_path / "n.npz", "--like", like)
    for words in (["--own-skin"], ["--parts", "r_hand"]):
        args = ("convert-taxels", tmp_path / "m.npz", tmp_path / "t.ini", "--like", like, *words)
        assert "only where a .ini is converted" in refused(*args)


@pytest.mark.parametrize(
    ("taxel", "part", "message"),
    [
        (f"27 ({10**300}) (0)", "r_hand", "expected counts from 0 to 2^53"),  # larger ones overflow in sums
        (f"27 ({2**60}) (0)", "r_hand", "expected counts from 0 to 2^53"),
        ("3 (1) (2)", "left_forearm", "expected each taxel once"),  # l_forearm is our left_forearm
    ],
)
def test_counts_beyond_every_robots_and_a_part_twice_are_refused(refused, like, tmp_path, taxel, part, message):
    text = like.read_text().replace("nTaxels 0", "nTaxels 1").replace("[r_hand]", f"{taxel}\n[{part}]")
    like.write_text(f"{text}3 (1) (2)\n")
    assert message in refused("convert-taxels", like, tmp_path / "m.npz")
    assert not (tmp_path / "m.npz").exists()

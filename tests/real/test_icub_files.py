"""The robot's own files: maps, skin positions and skin events, read and written again without a loss."""

from pathlib import Path

import numpy as np
import pytest
from data import shared_data

from learning.pps.memory import activation, load_memory
from pps_vision.app.cli import main
from pps_vision.recordings.skin_events import read_skin_events, touches_of, write_skin_events
from pps_vision.recordings.skin_positions import read_skin_positions, write_skin_positions
from pps_vision.recordings.taxels_ini import read_taxels, write_taxels

MAPS = (
    "taxels1D_45cmRF_skinV2_learned_noLeftHand.ini",
    "taxels1D_learnedAll.ini",
    "taxels2D_learned_rightHandLeftForearm.ini",
)
SKINS = [f"{part}.txt" for side in ("left", "right") for part in
         (f"{side}_forearm_V2", f"{side}_forearm_mesh", f"{side}_hand_V2_1")]  # fmt: skip


def words(file: Path) -> list[list[str]]:
    """All but the white space."""
    lines = file.read_text().replace("(", " ( ").replace(")", " ) ").splitlines()
    return [line.split() for line in lines if line.strip()]


@pytest.mark.parametrize("name", MAPS)
def test_a_map_read_and_written_carries_all_it_carried(name: str, tmp_path: Path) -> None:
    file = shared_data("icub_files", "taxels", name)
    write_taxels(tmp_path / name, read_taxels(file))
    assert words(tmp_path / name) == words(file)


@pytest.mark.parametrize("name", MAPS)
def test_a_map_goes_through_our_memory_and_back(name: str, tmp_path: Path) -> None:
    file = shared_data("icub_files", "taxels", name)
    main(["convert-taxels", str(file), str(tmp_path / "m.npz")])
    main(["convert-taxels", str(tmp_path / "m.npz"), str(tmp_path / "back.ini"), "--like", str(file)])
    assert words(tmp_path / "back.ini") == words(file)


def test_a_map_learned_on_the_robot_expects_here_what_it_expected_there(tmp_path: Path) -> None:
    """Its forearm expects more of what is near and soon than of what is far and late."""
    file = shared_data("icub_files", "taxels", MAPS[2])
    main(["convert-taxels", str(file), str(tmp_path / "m.npz")])
    memory = load_memory(tmp_path / "m.npz")
    assert memory.params.ttc_range_s == (0.0, 1.2)
    forearm = [i for i, name in enumerate(memory.taxel_ids) if name.startswith("left_forearm")]
    n = len(memory.taxel_ids)
    near, far = (activation(memory, np.full(n, D), np.full(n, TTC))[forearm] for D, TTC in ((0.03, 0.1), (0.19, 1.1)))
    assert near.mean() > 1.3 * far.mean()


@pytest.mark.parametrize("name", SKINS)
def test_skin_positions_read_and_written_are_the_same(name: str, tmp_path: Path) -> None:
    skin = read_skin_positions(shared_data("icub_files", "skin_positions", name))
    write_skin_positions(tmp_path / name, skin)
    again = read_skin_positions(tmp_path / name)
    assert (again.name, again.spatial_sampling, again.mapping) == (skin.name, skin.spatial_sampling, skin.mapping)
    np.testing.assert_array_equal(np.hstack([again.positions_m, again.normals]).view(np.int64),
                                  np.hstack([skin.positions_m, skin.normals]).view(np.int64))  # fmt: skip
    assert skin.exists.sum() == (48 if "hand" in name else 276 if "mesh" in name else 240)


def test_skin_events_read_and_written_are_the_same(tmp_path: Path) -> None:
    log = shared_data("icub_files", "skin_events.data.log")
    problems: list[object] = []
    events = read_skin_events(log, problems)  # type: ignore[arg-type]
    assert (len(events), problems) == (3479, [])
    write_skin_events(tmp_path / "data.log", events)
    assert words(tmp_path / "data.log") == words(log)


def test_skin_events_touch_the_virtual_taxels_they_should() -> None:
    """A contact's centre lies within 3 cm of the virtual taxels the skin position file assigns it to."""
    events = read_skin_events(shared_data("icub_files", "skin_events.data.log"), [])
    skin = read_skin_positions(shared_data("icub_files", "skin_positions", "left_forearm_mesh.txt"))
    away = []
    for event, touch in zip(events, touches_of(events, {"left_forearm": skin.mapping}), strict=True):
        contacts = [contact for contact in event.contacts if contact.skin_part == 2]
        for name in touch.taxel_ids:
            taxel = skin.positions_m[int(name.partition(":")[2])]
            away.append(min(np.linalg.norm(np.subtract(c.geometric_center, taxel)) for c in contacts))
    assert len(away) > 1000
    assert np.percentile(away, 95) < 0.03

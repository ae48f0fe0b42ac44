"""The robot's own files: maps read and written again without a loss, and skin events."""

import re
from pathlib import Path

import numpy as np
import pytest
from data import shared_data

from learning.pps.memory import activation, load_memory
from pps_vision.app.cli import main
from pps_vision.recordings.formats.yarp import read_touches
from pps_vision.recordings.icub_eyes import read_icub_eyes
from pps_vision.recordings.taxels_ini import read_taxels, write_taxels
from pps_vision.recordings.warnings import Problem
from pps_vision.robot.icub import LEFT_EYE, RIGHT_EYE

MAPS = (
    "taxels1D_45cmRF_skinV2_learned_noLeftHand.ini",
    "taxels1D_learnedAll.ini",
    "taxels2D_learned_rightHandLeftForearm.ini",
)


def words(file: Path) -> list[list[str]]:
    """All but the white space."""
    lines = file.read_text().replace("(", " ( ").replace(")", " ) ").splitlines()
    return [line.split() for line in lines if line.strip()]


def test_the_eyes_are_those_of_the_robot():
    assert read_icub_eyes(shared_data("icub_files", "icubEyes.ini")) == (LEFT_EYE, RIGHT_EYE)


@pytest.mark.parametrize("name", MAPS)
def test_a_map_read_and_written_carries_all_it_carried(name, tmp_path):
    file = shared_data("icub_files", "taxels", name)
    write_taxels(tmp_path / name, read_taxels(file))
    assert words(tmp_path / name) == words(file)


@pytest.mark.parametrize("name", MAPS)
def test_a_map_goes_through_our_memory_and_back(name, tmp_path):
    file = shared_data("icub_files", "taxels", name)
    main(["convert-taxels", str(file), str(tmp_path / "m.npz")])
    main(["convert-taxels", str(tmp_path / "m.npz"), str(tmp_path / "back.ini"), "--like", str(file)])
    assert words(tmp_path / "back.ini") == words(file)


def test_a_map_learned_on_the_robot_expects_here_what_it_expected_there(tmp_path):
    """The forearm's activation is higher for near, imminent contacts than for distant, late ones."""
    file = shared_data("icub_files", "taxels", MAPS[2])
    main(["convert-taxels", str(file), str(tmp_path / "m.npz")])
    memory = load_memory(tmp_path / "m.npz")
    assert memory.params.ttc_range_s == (0.0, 1.2)
    forearm = [i for i, name in enumerate(memory.taxel_ids) if name.startswith("left_forearm")]
    n = len(memory.taxel_ids)
    near = activation(memory, np.full(n, 0.03), np.full(n, 0.1))[forearm]
    distant = activation(memory, np.full(n, 0.19), np.full(n, 1.1))[forearm]
    assert near.mean() > 1.3 * distant.mean()


def test_skin_events_touch_the_virtual_taxels_they_should():
    """A contact's centre lies within 3 cm of the virtual taxels the skin position file assigns it to."""
    log = shared_data("icub_files", "skin_events.data.log")
    lines = shared_data("icub_files", "skin_positions", "left_forearm_mesh.txt").read_text().splitlines()
    mapping = tuple(int(word) for word in lines[2].split(maxsplit=1)[1].strip("()").split())
    positions = np.array([line.split()[:3] for line in lines[4:] if line], dtype=float)
    assert len(positions) == len(mapping) == 384
    problems: list[Problem] = []
    touches = read_touches(log, {"left_forearm": mapping}, problems)
    assert (len(touches), problems) == (3479, [])
    # after the four numbers and three vectors comes the geometric centre
    of_forearm = re.compile(r"\(\(\d+ \d+ \d+ 2\) " + 3 * r"\([^()]*\) " + r"\(([^()]*)\)")
    away = []
    for row, touch in zip(log.read_text().splitlines(), touches, strict=True):
        centers = [np.array(text.split(), dtype=float) for text in of_forearm.findall(row)]
        for name in touch.taxel_ids:
            taxel = positions[int(name.partition(":")[2])]
            away.append(min(np.linalg.norm(center - taxel) for center in centers))
    assert len(away) > 1000
    assert np.percentile(away, 95) < 0.03

"""Every command of the list of commands runs in a folder that holds its input files.

The longer commands run in `make test-all`.
"""

import os
import shlex
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from glob import glob
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from calibrations import store, write_camchain
from commands import prepare
from documents import ROOT, typed
from flat_patterns import SIZE, K, R, T
from laboratory import film, write_laboratory
from sound_inputs import READERS

from learning.pps.memory import PPSMemory, save_memory
from pps_vision.app.cli import main
from pps_vision.geometry.se3 import transform
from pps_vision.recordings.exchange import write_tum_rows
from pps_vision.robot.skin import icub_skin

RENDERED = (
    "render --stimulus ball --motion approach --target left_forearm:3 --speed 0.3 --seconds 1.5 --noise 2 --seed 1"
)
REPLACEMENTS = {  # for hardware and packages that may be missing, and for long runs
    "--device cuda": "--device cpu",
    "--viewer": "--viewer" if find_spec("rerun") else "",
    "session double-touch --trials 45": "session double-touch --trials 1",
    "session babbling --arm right": "session babbling --arm right --postures 260",
    "bench loop --n 20": "bench loop --short --out measured --n 1",
    "encounters --out": "encounters --n 10 --share 0.02 --out",
}
LONG = (
    *(
        "render",
        "session",
        "clock",
        "joints",
        "learn",
        "reach train",
        "demo",
        "bench",
        "encounters",
        "batch",
        "--report",
        "--device",
        "--video",
    ),
    *(
        "rec --one",
        "rec --smooth",
        "--reduction",
        "--also",
        "--map",
    ),  # variants of `track rec`, with tests of their own
)


def is_long(line: str) -> bool:
    return any(word in line for word in LONG)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The input files of the commands, under the names of the list."""
    folder = tmp_path_factory.mktemp("files")
    write_laboratory(folder)
    prepare(folder, [])
    save_memory(folder / "memory.npz", PPSMemory.empty(icub_skin()))
    READERS["map"].write(folder)
    for file in READERS["bag_mcap"].write(folder):
        if file.suffix == ".mcap":
            file.rename(folder / "drive.mcap")
    main([*RENDERED.split(), "--out", str(folder / "rec")])
    copies = {"left.mp4": ("l.mp4", "video.mp4"), "right.mp4": ("r.mp4",)}
    shutil.rmtree(folder / "recs")
    for source, names in (copies | {"rec": ("rec1", "rec2", "recs/a", "recs/b")}).items():
        for name in names:
            (shutil.copytree if source == "rec" else shutil.copy)(folder / source, folder / name)
    trimesh.creation.cylinder(30, 80).export(folder / "cup.stl")
    write_calibrations(folder)
    sides = [sorted((folder / "tag" / side).glob("*.png")) for side in ("left", "right")]
    tags = [np.hstack([cv2.imread(str(file)) for file in pair]) for pair in zip(*sides, strict=True)]
    film(folder / "tag.mp4", tags)
    for side, name in (("left", "1L"), ("right", "1R")):
        (folder / "seq").mkdir(exist_ok=True)
        for k, file in enumerate(sorted((folder / "frames" / side).glob("*.png"))):
            cv2.imwrite(str(folder / "seq" / f"{name}{k:03d}.jpg"), cv2.imread(str(file)))
    truth = np.loadtxt(folder / "rec" / "truth.csv", delimiter=",", skiprows=1, usecols=range(4))
    write_tum_rows(folder / "other.tum", truth[:, 0], truth[:, 1:] + 0.001)
    (folder / "path").mkdir()
    shutil.copy(folder / "rec" / "truth.csv", folder / "path" / "trajectory.csv")
    shutil.copy(folder / "true_boxes.txt", folder / "truth.txt")
    shutil.copy(folder / "true_boxes.txt", folder / "boxes.csv")
    return folder


def write_calibrations(folder: Path) -> None:
    """The laboratory's cameras as Kalibr writes them, and in an OpenCV file in inches."""
    (folder / "seq").mkdir()
    write_camchain(folder / "camchain.yaml", *K, transform(R, T), SIZE)
    store(folder / "seq" / "calibration_1.xml", K1=K[0], K2=K[1], R=R, T=T / 0.0254)


@contextmanager
def cluster() -> Iterator[str]:
    """The address of a Dask cluster of one worker."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as local:
        yield local.scheduler_address


def words_of(command: str) -> list[str]:
    """The words of a command after the shell's expansion of unquoted patterns."""
    words = shlex.split(command, posix=False)
    return [
        name
        for word in words
        for name in (sorted(glob(word)) if set("*?") & set(word) else []) or [shlex.split(word)[0]]
    ]


@pytest.mark.parametrize(
    "line",
    [
        pytest.param(line, marks=[pytest.mark.long] * is_long(line))
        for line in typed(ROOT / "docs" / "commands.md") if line.startswith("pps-vision ")
    ],
)  # fmt: skip
def test_a_command_of_the_list(line, files, tmp_path, monkeypatch):
    folder = tmp_path / "here"
    shutil.copytree(files, folder, copy_function=os.link)
    monkeypatch.chdir(folder)
    for original, replacement in REPLACEMENTS.items():
        line = line.replace(original, replacement)
    with cluster() if "--scheduler" in line else nullcontext("") as address:
        for command in line.replace("tcp://host:8786", address).split("&&"):
            program, *words = words_of(command)
            assert program == "pps-vision"
            out = Path(words[words.index("--out") + 1]) if "--out" in words else None
            if out and out.is_dir():
                shutil.rmtree(out)
            main(words)
            assert out is None or out.exists()

"""The commands of requirements-track.txt load nothing that it does not install."""

import os
import re
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

import numpy as np
from calibrations import write_camchain
from videos import write_video

from pps_vision.geometry.se3 import transform

ROOT = Path(__file__).parents[1]
SCRIPT = """
import sys
tops = set(sys.argv.pop().split(","))
class Refusal:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in tops:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Refusal())
from pps_vision.app.cli import main
rig = ["--calib", "camchain.yaml"]
main(["info", "a.mp4", *rig])
main(["track", "a.mp4", *rig, "--report", "--also", "tum", "anipose", "mot", "coco", "--smooth", "--out", "out/a.mp4"])
main(["report", "out/a.mp4"])
main(["track2d", "a.mp4", "--init", "10", "10", "60", "60", "--out", "boxes.csv"])
main(["evaluate", "--boxes", "boxes.csv", "boxes.csv", "--figure", "curves.png"])
main(["batch", "a.mp4", *rig, "--out", "out", "--report"])
"""


def pins(file: Path) -> dict[str, str]:
    return dict(re.findall(r"^([\w.-]+)==(\S+)$", file.read_text(), re.MULTILINE))


def test_pins_are_those_of_the_whole_package():
    for_tracking = pins(ROOT / "requirements-track.txt")
    assert for_tracking.items() <= pins(ROOT / "constraints.txt").items()
    assert not for_tracking.keys() & {
        "torch",
        "kornia",
        "pin",
        "coal",
        "trimesh",
        "scikit-learn",
        "scikit-robot-pyrender",
    }


def test_the_commands_need_nothing_else(tmp_path):
    wanted = {re.sub(r"[-_.]+", "-", name).lower() for name in (*pins(ROOT / "requirements-track.txt"), "pps-vision")}
    refused = [
        top
        for top, owners in packages_distributions().items()
        if not {re.sub(r"[-_.]+", "-", owner).lower() for owner in owners} & wanted and "." not in top
    ]
    refused += ["pinocchio", "coal", "eigenpy"]  # lie in a folder of their own, which importlib.metadata does not list
    assert {"torch", "kornia", "trimesh", "sklearn", "pandas"} <= set(refused)
    write_video(tmp_path / "a.mp4", [k / 20 for k in range(4)])
    K = np.array([[80.0, 0, 40], [0, 80, 60], [0, 0, 1]])
    write_camchain(tmp_path / "camchain.yaml", K, K, transform(translation=(-0.12, 0, 0)), (80, 120))
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", SCRIPT, ",".join(refused)]
    process = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert process.returncode == 0, process.stderr
    assert "1 of 1 recordings tracked" in process.stdout
    assert (tmp_path / "out" / "report.html").is_file()
    page = (tmp_path / "out" / "a.mp4" / "report.html").read_text()
    assert page.count("data:image/jpeg") == len(list((tmp_path / "out" / "a.mp4" / "keyframes").iterdir())) == 4
    assert "pps-vision track a.mp4 --calib camchain.yaml" in page

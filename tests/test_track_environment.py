"""The commands of requirements-track.txt load nothing that it does not install."""

import os
import re
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

from videos import write_video

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
    camera = "  camera_model: pinhole\n  distortion_coeffs: [0, 0, 0, 0]\n  distortion_model: radtan\n"
    camera += "  intrinsics: [80, 80, 40, 60]\n  resolution: [80, 120]\n"
    pose = "  T_cn_cnm1:\n  - [1, 0, 0, -0.12]\n  - [0, 1, 0, 0]\n  - [0, 0, 1, 0]\n  - [0, 0, 0, 1]\n"
    (tmp_path / "camchain.yaml").write_text(f"cam0:\n{camera}cam1:\n{pose}{camera}")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", SCRIPT, ",".join(refused)]
    process = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert process.returncode == 0, process.stderr
    assert "1 of 1 recordings tracked" in process.stdout
    assert (tmp_path / "out" / "report.html").is_file()
    page = (tmp_path / "out" / "a.mp4" / "report.html").read_text()
    assert page.count("data:image/jpeg") == len(list((tmp_path / "out" / "a.mp4" / "keyframes").iterdir())) == 4
    assert "pps-vision track a.mp4 --calib camchain.yaml" in page

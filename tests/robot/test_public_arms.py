"""Public arms of the package example-robot-data (131 MB), with two cameras on a stand and skin on the hand, learn reach
and touch.  Skipped where the package is not installed.
"""

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest

from learning.pps.memory import load_memory
from pps_vision.app.cli import main
from pps_vision.recordings.robot_file import read_robot

try:
    FOLDER = Path(str(distribution("example-robot-data").locate_file("cmeel.prefix/share/example-robot-data/robots")))
except PackageNotFoundError:
    pytest.skip("example-robot-data is not installed", allow_module_level=True)

pytestmark = pytest.mark.long
UR5 = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
ARMS = {  # URDF, root, joints of the arm, hand, home (degrees)
    "Panda": (
        "panda_description/urdf/panda.urdf",
        "panda_link0",
        [f"panda_joint{k}" for k in range(1, 8)],
        "panda_hand",
        {"panda_joint4": -110, "panda_joint6": 110},
    ),
    "UR5": (
        "ur_description/urdf/ur5_robot.urdf",
        "base_link",
        [f"{name}_joint" for name in UR5],
        "tool0",
        {"shoulder_lift_joint": -70, "elbow_joint": 90, "wrist_1_joint": -20},
    ),
    "Jaco": (
        "kinova_description/robots/kinova.urdf",
        "j2s6s200_link_base",
        [f"j2s6s200_joint_{k}" for k in range(1, 7)],
        "j2s6s200_end_effector",
        {"j2s6s200_joint_2": 180, "j2s6s200_joint_3": 120},
    ),
    "TIAGo": (  # with wheels, a lift and a hand of joints that mimic others
        "tiago_description/robots/tiago.urdf",
        "base_footprint",
        ["torso_lift_joint", *(f"arm_{k}_joint" for k in range(1, 8))],
        "arm_tool_link",
        {"arm_1_joint": 60, "arm_4_joint": 90},
    ),
}


def write_robot(folder: Path, name: str) -> Path:
    """robot.toml with cameras 0.6 m beside the hand at home, and the skin on its side that they see."""
    urdf, root, joints, hand, home = ARMS[name]
    place, across = ([0.0, 0.0, 0.0], [0.0, 0.6, -0.8])
    for _ in range(2):  # first to know where the hand is
        x, y, z = place
        rows = [
            f"patch,{hand},{k},{','.join(f'{0.1 * n + 0.02 * (k - 1) * (i == 2):.5f}' for i, n in enumerate(across))},"
            f"{','.join(f'{n:.5f}' for n in across)}"
            for k in range(3)
        ]
        (folder / "skin.csv").write_text("\n".join(["part,frame,taxel,x_m,y_m,z_m,nx,ny,nz", *rows]) + "\n")
        eyes = [
            f'{side}_eye = {{link = "{root}", xyz_m = [{x + shift}, {y + 0.6}, {z}], rpy_deg = [-90, 0, 180]}}'
            for side, shift in (("left", 0.06), ("right", -0.06))
        ]
        text = [f'urdf = "{FOLDER / urdf}"', 'skin = "skin.csv"', f'root = "{root}"', *eyes]
        text += [f"right_arm = {joints!r}".replace("'", '"'), f'right_palm = "{hand}"', "[home_deg]"]
        text += [f"{joint} = {angle}" for joint, angle in home.items()]
        (folder / "robot.toml").write_text("\n".join(text) + "\n")
        setup = read_robot(folder / "robot.toml")
        T = setup.robot.at(setup.home_rad).T_root(hand)
        place, across = T[:3, 3].tolist(), (T[:3, :3].T @ [0.0, 0.6, -0.8]).tolist()
    return folder / "robot.toml"


@pytest.mark.parametrize("name", ARMS)
def test_a_public_arm_learns_reach_and_touch(name, tmp_path, capsys):
    robot = ["--robot", str(write_robot(tmp_path, name))]
    words = "reach train --arm right --ik-budget 600 --max-error 0.3 --out"
    main([*words.split(), str(tmp_path / "map.npz"), *robot])
    assert "was not reached" not in capsys.readouterr().out
    main(["reach", "show", str(tmp_path / "map.npz"), "--out", str(tmp_path / "map.png"), *robot])
    words = "render --stimulus ball --motion approach --target patch:1 --seconds 3 --speed 0.12 --noise 2 --out"
    main([*words.split(), str(tmp_path / "rec"), *robot])
    main(["learn", str(tmp_path / "rec"), "--out", str(tmp_path / "memory.npz"), *robot])
    assert load_memory(tmp_path / "memory.npz").samples[:, 0].sum() > 5  # touched
    main(["show", str(tmp_path / "memory.npz"), "--out", str(tmp_path / "landscapes.png"), *robot])
    assert (tmp_path / "landscapes.png").is_file()

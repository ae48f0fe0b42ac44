"""Robots that are not our iCub: the official iCub model, and an arm of seven joints beside two fixed cameras."""

from dataclasses import replace
from itertools import takewhile
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from data import ARM7, shared_data

from learning.pps.memory import PPSMemory, load_memory
from learning.reach.map import ReachableMap
from pps_vision.app.cli import main
from pps_vision.app.simulation import SimulationScene, log_of, make_episode, new_pipeline, open_scene, simulate, train
from pps_vision.errors import InputError
from pps_vision.recordings.robot_file import read_robot, read_skin, robot_setup
from pps_vision.robot.gaze import GazeModel
from pps_vision.robot.icub import icub_setup
from pps_vision.robot.model import FrameNames, Robot
from pps_vision.robot.robot_setup import RobotSetup
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import Skin

SETUP = read_robot(ARM7)


@pytest.fixture(scope="module")
def memory(tmp_path_factory: pytest.TempPathFactory) -> PPSMemory:
    """The memory that one rendered touch of the skin patch taught, by the command line."""
    out = tmp_path_factory.mktemp("arm7")
    scene = "--stimulus ball --motion approach --target forearm:4 --seconds 3 --speed 0.12 --noise 2 --seed 1"
    main(["render", *scene.split(), "--robot", str(ARM7), "--out", str(out / "rec")])
    main(["learn", str(out / "rec"), "--robot", str(ARM7), "--out", str(out / "memory.npz")])
    return load_memory(out / "memory.npz")


def test_a_touch_is_learned_by_the_taxels_that_felt_it(memory):
    positive = memory.samples[:, 0]
    assert memory.taxel_ids == SETUP.skin.taxel_ids
    assert positive[4] > 10
    assert positive[[0, 8]].sum() == 0  # 5 cm along the arm: not touched


@pytest.mark.parametrize("avoid", [False, True])
def test_the_arm_withdraws_from_what_it_learned_would_touch(memory, avoid):
    with open_scene(2.0, 3, SETUP) as scene:
        log = _episode(scene, memory, avoid)
    assert log.was_touched == (not avoid)
    assert log.was_commanded == avoid
    moved = np.ptp(log.q_rad, axis=0) > 1e-9
    assert moved.any() == avoid


@pytest.mark.long
def test_the_demo_of_another_robot(tmp_path, capsys):
    main(["demo", "--robot", str(ARM7), "--out", str(tmp_path / "demo")])
    said = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert said[:2] == [
        "octopus approaching, avoidance off touched arm still",
        "octopus approaching, avoidance on not touched arm moved",
    ]
    assert all(line.endswith("not touched arm still") for line in said[2:4])
    assert f"--robot {ARM7}" in (tmp_path / "demo" / "report.html").read_text()


def test_another_robot_is_approached_where_both_cameras_see_its_skin():
    """A forearm turned away cannot be trained."""
    with open_scene(2.0, 3, SETUP) as scene:
        assert set(scene.trained_taxels) < set(SETUP.skin.taxel_ids)
    with (
        open_scene(2.0, 3, replace(SETUP, skin=_turned_away(SETUP.skin))) as scene,
        pytest.raises(InputError, match=r"arm\.urdf: none of 9 taxels of the right arm faces both cameras"),
    ):
        train(scene, 1)


def _turned_away(skin: Skin) -> Skin:
    return Skin(tuple(replace(part, normals=-part.normals) for part in skin.parts))


def _episode(scene: SimulationScene, memory: PPSMemory, avoid: bool):
    episode = make_episode("approach", scene, "forearm:4", "ball", np.random.default_rng(5), 0.12)
    until_s = episode.motion.contact_s + 0.2
    steps = simulate(scene, episode, new_pipeline(scene, memory).step, avoid)
    return log_of(scene, episode, list(takewhile(lambda step: step.frame.stamp_s < until_s, steps)), avoid)


def test_the_map_of_the_arm_holds_for_where_its_hand_has_been(tmp_path):
    """Points in view where a random posture's palm is are within reach; those beyond the arm's length are not."""
    words = "--arm right --ik-budget 600 --max-error 0.3"
    main(["reach", "train", *words.split(), "--robot", str(ARM7), "--out", str(tmp_path / "map.npz")])
    learned = ReachableMap.load(tmp_path / "map.npz")
    robot = SETUP.robot
    rng = np.random.default_rng(0)
    hands = [robot.at(q).point("palm") for q in rng.uniform(robot.lower_rad, robot.upper_rad, (3000, 7))]
    gaze = GazeModel(robot).gaze(np.array(hands), learned.limits)
    visible = gaze[np.isfinite(gaze).all(axis=1)]
    assert len(visible) > 100
    assert learned.query(visible).reachable.mean() > 0.9
    anywhere = rng.uniform(learned.limits.lower, learned.limits.upper, (3000, 3))
    too_far = np.linalg.norm(GazeModel(robot).points(anywhere) - [0, 0, 0.34], axis=1) > 0.28 + 0.26 + 0.06
    assert too_far.sum() > 100
    assert learned.query(anywhere[too_far]).reachable.mean() < 0.05


ICUB = """
urdf = "{urdf}"
skin = "skin.csv"
root = "root_link"
left_eye = {{link = "head", xyz_m = [-0.034, 0.1, 0.05], rpy_deg = [0, 90, 90]}}
right_eye = {{link = "head", xyz_m = [0.034, 0.1, 0.05], rpy_deg = [0, 90, 90]}}
left_arm = ["l_shoulder_pitch", "l_shoulder_roll", "l_shoulder_yaw", "l_elbow"]
left_palm = "l_hand_dh_frame"
"""


def test_the_official_icub_is_read_with_its_meshes_as_boxes(tmp_path):
    icub_models = pytest.importorskip("icub_models")
    (tmp_path / "robot.toml").write_text(ICUB.format(urdf=icub_models.get_model_file("iCubLisboa01")))
    rows = (
        "part,frame,taxel,x_m,y_m,z_m,nx,ny,nz\nleft_forearm,l_forearm_dh_frame,27,-.031,-.097,.014,-.976,.061,.208\n"
    )
    (tmp_path / "skin.csv").write_text(rows)
    setup = read_robot(tmp_path / "robot.toml")
    ours = icub_setup()
    assert {body.shape for body in setup.robot.bodies} == {"box"}
    assert len(setup.robot.bodies) > 20
    assert SelfCollision(setup.robot).distance_m(setup.home_rad) < 0  # so that its arm is held, as docs/robots.md says
    positions, normals = setup.skin.at(setup.robot.at(np.zeros(32)))
    our_positions, facing = ours.skin.at(ours.robot.at(np.zeros(ours.robot.n_joints)))
    np.testing.assert_allclose(positions[0], our_positions[0], atol=2e-4)
    np.testing.assert_allclose(normals[0], facing[0], atol=1e-5)


def test_a_root_elsewhere_moves_everything_alike(tmp_path):
    """The arm bolted to a world: in the frame of its base it is as before."""
    bolt = '<link name="world"/><joint name="bolt" type="fixed"><parent link="world"/><child link="base"/>'
    placed = bolt + '<origin xyz="1 2 3" rpy="0.1 0.2 0.3"/></joint>'
    text = ARM7.with_name("arm.urdf").read_text()
    (tmp_path / "placed.urdf").write_text(text.replace('<robot name="arm7">', f'<robot name="arm7">{placed}'))
    names = FrameNames("palm", "palm", gaze_joints=())
    alone = Robot(ARM7.with_name("arm.urdf"), names)
    in_world = Robot(tmp_path / "placed.urdf", names)
    in_base = Robot(tmp_path / "placed.urdf", names, "base")
    T_base_world = np.linalg.inv(pin.SE3(pin.rpy.rpyToMatrix(0.1, 0.2, 0.3), np.array([1.0, 2.0, 3.0])).homogeneous)
    q = np.linspace(-0.5, 0.7, 7)
    np.testing.assert_allclose(T_base_world @ in_world.at(q).T_root("palm"), alone.at(q).T_root("palm"), atol=1e-12)
    np.testing.assert_allclose(in_base.at(q).T_root("palm"), alone.at(q).T_root("palm"), atol=1e-12)
    np.testing.assert_allclose(in_base.at(q).T_root("world"), T_base_world, atol=1e-12)
    np.testing.assert_allclose(in_base.at(q).jacobian("palm"), alone.at(q).jacobian("palm"), atol=1e-12)


def test_a_part_may_have_a_wider_margin(tmp_path):
    for name in ("arm.urdf", "skin.csv"):
        (tmp_path / name).write_text(ARM7.with_name(name).read_text())
    (tmp_path / "robot.toml").write_text(ARM7.read_text() + "\n[margins]\nforearm = 2\n")
    assert (read_robot(tmp_path / "robot.toml").skin.margins == 2).all()
    assert (SETUP.skin.margins == 1).all()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('urdf = "arm.urdf"', 'urdf = "none.urdf"', r"none\.urdf: cannot be read: No such file"),
        ('urdf = "arm.urdf"', "urdf = arm.urdf", r"robot\.toml:2: cannot be read as TOML"),
        ('root = "base"', 'rot = "base"', r"robot\.toml:4: unknown key rot; expected one of urdf, skin"),
        ('root = "base"', 'root = "palm"', r"arm\.urdf: root frame palm is moved by joints"),
        ('"a7"]', '"a8"]', r"robot\.toml:7: unknown 'a8' in right_arm; expected some of a1, a2"),
        ('right_palm = "palm"', "", r"robot\.toml:7: right_arm .*; expected both right_arm and right_palm"),
        ('"palm"', '"paw"', r"robot\.toml:8: unknown 'paw' in right_palm"),
        ("a4 = 60", "a4 = 160", r"robot\.toml:12: home_deg 160 of a4; expected degrees from -126.1 to 126.1"),
        ("a4 = 60", "b4 = 60", r"robot\.toml:12: unknown joint b4"),
        ("rpy_deg = [-113.7, 0, 180]}\nright", "rpy_deg = [0, 0]}\nright", r"robot\.toml:5: left_eye .*rpy_deg"),
        ("rpy_deg = [-113.7, 0, 180]}\nright", "rpy_deg = [0, nan, 0]}\nright", r"robot\.toml:5: left_eye .*rpy_deg"),
        ('link = "base"', 'link = "bass"', r"robot\.toml:5: unknown 'bass' in left_eye; expected some of base"),
        ('root = "base"', 'root = "bass"', r"robot\.toml:4: unknown 'bass' in root; expected some of base"),
        ('root = "base"', "root = 3", r"robot\.toml:4: root 3; expected a name in quotes"),
        ('"a7"]', "7]", r"robot\.toml:7: no list of names: .* of right_arm"),
        ('skin = "skin.csv"', "skin = [1]", r"robot\.toml:3: no list of names: \[1\] of skin"),
        ('{link = "base"', '{lnk = "base"', r"robot\.toml:5: left_eye .*; expected a link, or \{link = "),
        ("xyz_m = [", 'xyz_m = ["x", ', r"robot\.toml:5: left_eye .*; expected a link"),
        (
            'root = "base"',
            'root = "base"\ngaze_joints = ["a1"]',
            r"robot\.toml:5: gaze_joints .*; expected neck yaw, neck",
        ),
        ("[home_deg]", '[ports]\narm = ["b1"]\n[home_deg]', r"unknown 'b1' in port arm; expected joints of a1, a2"),
        ("[home_deg]", "[ports]\narm = 3\n[home_deg]", r"no list of names: 3 of arm"),
        ("[home_deg]", "[margins]\nhand = 2\n[home_deg]", r"unknown 'hand' in margins; expected skin parts of forearm"),
        (
            "[home_deg]",
            "[margins]\nforearm = 0\n[home_deg]",
            r"toml:11: margin 0 of forearm; expected a factor above 0",
        ),
        ('skin = "skin.csv"\n', "", r"robot\.toml: no skin; expected urdf, skin, left_eye, right_eye"),
    ],
)
def test_what_is_wrong_in_a_robot_file_is_named(tmp_path, old, new, message):
    for name in ("arm.urdf", "skin.csv"):
        (tmp_path / name).write_text(ARM7.with_name(name).read_text())
    text = ARM7.read_text()
    assert old in text
    (tmp_path / "robot.toml").write_text(text.replace(old, new))
    with pytest.raises(InputError, match=message):
        read_robot(tmp_path / "robot.toml")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("forearm,forearm,1,", "forearm,arm,1,", r"skin\.csv:3: frame 'arm'; expected one of .*forearm"),
        ("forearm,forearm,1,", "forearm,forearm,0,", r"skin\.csv:3: taxel forearm:0; expected each number from 0 once"),
        ("0.00000,1.00000,0\n", "0,0,0\n", r"skin\.csv:2: normal \[.*\]; expected one of length 1"),
        ("0.03500,0.06", "nan,0.06", r"skin\.csv:2: .*nan.*; expected part,frame,taxel"),
        ("0.03500,0.06", "35.0,0.06", r"skin\.csv:2: taxel forearm:0 at .*35.*; expected metres, at most 5 from its"),
        ("nz\n", "n\n", r"skin\.csv:1: no column nz"),
        ("forearm,forearm,0,", "fore arm,forearm,0,", r"skin\.csv:2: part 'fore arm'; expected a name of letters"),
        ("forearm,forearm,0,", "forearm,palm,0,", r"skin\.csv: part forearm in several frames; expected taxels"),
    ],
)
def test_what_is_wrong_in_a_skin_file_is_named(tmp_path, old, new, message):
    text = ARM7.with_name("skin.csv").read_text()
    assert old in text
    (tmp_path / "skin.csv").write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=message):
        read_robot(ARM7, skin=tmp_path / "skin.csv")


def test_the_icubs_own_skin_file_has_our_taxels():
    """The forearm's calibration names the virtual taxels; ours are of the paper."""
    setup: RobotSetup = robot_setup(skin=shared_data("icub_files", "skin_positions", "left_forearm_mesh.txt"))
    (part,) = setup.skin.parts
    (ours, *_) = icub_setup().skin.parts
    assert (part.name, part.frame) == ("left_forearm", "left_forearm")
    assert set(ours.ids) <= set(part.ids)
    where = [part.ids.index(i) for i in ours.ids]
    np.testing.assert_allclose(part.positions_m[where], ours.positions_m, atol=1e-4)
    np.testing.assert_allclose(part.normals[where], ours.normals, atol=2e-3)


def test_the_skin_of_the_upper_arm_lies_on_it(tmp_path):
    """With a TAB or a space behind `name`; its frame is that after the shoulder's yaw: the elbow does not move it."""
    rows = "taxel2Repr (3 3 3 3 -2 3)\n\n[calibration]\n" + 3 * "0 0 0 0 0 0\n" + "0.01 0.02 0.03 0 0 1\n"
    robot = icub_setup().robot
    for space in "\t", " ":
        (tmp_path / "part.txt").write_text(f"name{space}l_upper_arm\n{rows}")
        with pytest.warns(UserWarning, match="part.txt: 3 of 4 rows without a normal are left out"):
            (part,) = read_skin([tmp_path / "part.txt"], robot).parts
        assert (part.name, part.ids) == ("left_upper_arm", (3,))
    elbow = robot.chain(("left_shoulder_yaw", "left_elbow"), part.frame)
    assert np.ptp(elbow.positions([[0.3, 0.5], [0.3, 1.5]], (0, 0, 0.1))[0], axis=0).max() < 1e-12
    np.testing.assert_allclose(
        robot.at(np.zeros(robot.n_joints)).point(part.frame),
        robot.at(np.zeros(robot.n_joints)).point("left_lower_arm"),
        atol=1e-12,
    )
    (tmp_path / "part.txt").write_text(f"name torso\n{rows}")
    with pytest.warns(UserWarning, match="rows without a normal"):
        (part,) = read_skin([tmp_path / "part.txt"], robot).parts
    assert set(robot.moving(part.frame)) == {"torso_pitch", "torso_roll", "torso_yaw"}


def test_a_skin_part_in_the_icubs_form_is_read(tmp_path):
    """Taxel 1 is represented by 0, 3 by none, and 2 has no normal; what follows six numbers of a row does not count."""
    robot = read_robot(ARM7).robot
    file = tmp_path / "part.txt"
    head = "name forearm\ntaxel2Repr ( 0 0 2 -1 4 )\n[calibration]\n"
    rows = ["0.1 0.2 0.3 0 0 2 0.5 x", "1 1 1 0 0 1", "0.4 0.5 0.6 0 0 0", "2 2 2 0 0 1", "0.7 0.8 0.9 -1 0 0"]
    file.write_text(head + "\n".join(rows) + "\n")
    (part,) = read_skin([file], robot).parts
    assert (part.name, part.frame, part.ids) == ("forearm", "forearm", (0, 4))
    np.testing.assert_allclose(part.positions_m, [[0.1, 0.2, 0.3], [0.7, 0.8, 0.9]])
    np.testing.assert_allclose(part.normals, [[0, 0, 1], [-1, 0, 0]])
    for old, new, message in (
        ("0 0 2 0.5 x", "0", r"part\.txt:4: 4 numbers; expected x y z nx ny nz"),
        ("( 0 0", "( a 0", r"part\.txt:2: 'a' is no whole number; expected"),
        ("name forearm", "", r"part\.txt: no name; expected name and rows below"),
    ):
        file.write_text((head + "\n".join(rows) + "\n").replace(old, new, 1))
        with pytest.raises(InputError, match=message):
            read_skin([file], robot)
    file.write_text(head)
    with pytest.raises(InputError, match=r"part\.txt: no taxel; expected name and rows below"):
        read_skin([file], robot)


def test_a_urdf_without_a_robot_file_is_refused():
    with pytest.raises(InputError, match=r"--urdf x\.urdf; expected --robot robot\.toml too"):
        robot_setup(urdf=Path("x.urdf"))


def test_a_camera_may_be_a_link_of_the_model(tmp_path):
    """Its name alone, then; the pose is that of the link, here of the palm."""
    text = (
        ARM7.read_text()
        .replace('"arm.urdf"', f'"{ARM7.parent}/arm.urdf"')
        .replace('"skin.csv"', f'"{ARM7.parent}/skin.csv"')
    )
    eye = next(line for line in text.splitlines() if line.startswith("left_eye"))
    q = np.linspace(-0.5, 0.5, 7)
    for camera in ('"palm"', '{link = "palm"}'):
        (tmp_path / "robot.toml").write_text(text.replace(eye, f"left_eye = {camera}"))
        robot = read_robot(tmp_path / "robot.toml").robot
        np.testing.assert_allclose(robot.eye_poses(q)[0], robot.at(q).T_root("palm"), atol=1e-9)
    (tmp_path / "robot.toml").write_text(text.replace('root = "base"', 'root = "ground"'))
    with pytest.raises(InputError, match=r"robot\.toml:4: unknown 'ground' in root; expected some of base"):
        read_robot(tmp_path / "robot.toml")
    with pytest.raises(ValueError, match="side 'middle': expected left or right"):
        robot.names.arm("middle")
    with pytest.raises(ValueError, match="side 'middle': expected left or right"):
        robot.names.palm("middle")

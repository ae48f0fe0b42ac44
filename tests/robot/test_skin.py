"""Taxels as published, mirrored, carried by the body, and touched where a ball is; the point of an arm that reaches."""

import re

import numpy as np
import pytest
from data import shared_data

from pps_vision.robot.icub import home, load_icub
from pps_vision.robot.skin import (
    INNER_FOREARM,
    OUTER_FOREARM,
    EndPoint,
    Skin,
    SkinPart,
    icub_skin,
    taxel_frame,
    touched_taxels,
)

ROBOT = load_icub()
SKIN = icub_skin()


def test_parts_hold_the_published_taxels():
    assert [(p.name, len(p.ids)) for p in SKIN.parts] == [
        ("left_forearm", 12), ("right_forearm", 12), ("left_palm", 4), ("right_palm", 4),
    ]  # fmt: skip
    assert set(SKIN.parts[0].ids) == set(INNER_FOREARM) | set(OUTER_FOREARM)
    assert SKIN.taxel_ids[0] == "left_forearm:27"
    i = SKIN.index("left_forearm:159")
    np.testing.assert_allclose(SKIN.parts[0].positions_m[i], [-0.018, -0.098, 0.037])
    np.testing.assert_allclose(SKIN.parts[0].normals[i], [-0.639, 0.054, 0.768], atol=1e-3)


def test_the_right_forearm_mirrors_the_left_one():
    """In y and z (R), positions and normals."""
    left, right = icub_skin(("left_forearm", "right_forearm")).parts
    assert left.ids == right.ids
    np.testing.assert_allclose(right.positions_m[0], [-0.031, 0.097, -0.014])
    np.testing.assert_allclose(right.normals[0], [-0.976, -0.061, -0.208], atol=1e-3)


@pytest.mark.parametrize(
    ("part", "file"),
    [
        ("left_forearm", "left_forearm_mesh.txt"),
        ("right_forearm", "right_forearm_mesh.txt"),
        ("left_palm", "left_hand_V2_1.txt"),
        ("right_palm", "right_hand_V2_1.txt"),
    ],
)
def test_taxels_are_where_the_robots_own_calibration_puts_them(part, file):
    """Row k of the robot's file is taxel k: position (m) and a normal of almost unit length."""
    lines = shared_data("icub_files", "skin_positions", file).read_text().splitlines()
    rows = [line.split() for line in lines if re.match(r"\s*-?\d", line)]
    table = np.array([[float(number) for number in row[:6]] for row in rows])
    (ours,) = icub_skin((part,)).parts
    theirs = table[list(ours.ids)]
    np.testing.assert_allclose(ours.positions_m, theirs[:, :3], atol=1e-4)
    unit = theirs[:, 3:] / np.linalg.norm(theirs[:, 3:], axis=1, keepdims=True)
    np.testing.assert_allclose(ours.normals, unit, atol=2e-3)


def test_the_inner_left_forearm_faces_the_robots_eyes_at_home():
    """Seen from between the eyes, the inner taxels face us (135 edgewise), the outer ones face away."""
    posture = ROBOT.at(home(ROBOT))
    skin = icub_skin(("left_forearm",))
    positions, normals = skin.at(posture)
    eyes = 0.5 * (posture.point("left_eye") + posture.point("right_eye"))
    facing = np.einsum("ni,ni->n", normals, eyes - positions) / np.linalg.norm(eyes - positions, axis=1)
    inner = [skin.index(f"left_forearm:{i}") for i in INNER_FOREARM]
    outer = [skin.index(f"left_forearm:{i}") for i in OUTER_FOREARM]
    assert facing[inner].min() > -0.1
    assert np.median(facing[inner]) > 0.3
    assert facing[outer].max() < -0.9


@pytest.mark.parametrize("part", icub_skin().parts, ids=lambda part: part.name)
def test_taxel_frames_have_z_along_the_normal_and_are_right_handed(part):
    for position, normal in zip(part.positions_m, part.normals, strict=True):
        T = taxel_frame(position, 2.5 * normal)
        np.testing.assert_allclose(T[:3, 2], normal, atol=1e-12)
        np.testing.assert_allclose(T[:3, 3], position)
        # nx = 0 is published as 1e-8, so the palms' axes are square to 1e-8 only
        np.testing.assert_allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=2e-8)
        assert T[1, 1] == 0.0  # the published construction keeps y in the part's xz plane
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)


def test_a_ball_touches_the_taxels_within_20_mm_of_its_surface():
    taxels = np.array([[0.0, 0, 0], [0.03, 0, 0], [0.0, 0.06, 0]])
    np.testing.assert_array_equal(touched_taxels(taxels, (0.0, 0.0, 0.0549), 0.035), [True, False, False])
    np.testing.assert_array_equal(touched_taxels(taxels, (0.0, 0.0, 0.0551), 0.035), [False, False, False])
    np.testing.assert_array_equal(touched_taxels(taxels, (0.015, 0.0, 0.0), 0.035), [True, True, False])


def test_unknown_taxels_are_answered_with_the_known_ones():
    with pytest.raises(ValueError, match=r"no taxel 'left_forearm:1'; this skin has left_forearm:27"):
        icub_skin().index("left_forearm:1")


def test_a_part_must_have_one_unit_normal_a_taxel():
    unit_z = np.array([[0.0, 0.0, 1.0]])
    for positions, normals in (
        (unit_z, unit_z),
        (np.vstack([unit_z, unit_z]), unit_z),
        (unit_z, np.vstack([unit_z, unit_z])),
    ):
        with pytest.raises(ValueError, match="2 ids, expected as many positions and normals"):
            SkinPart("nose", "head", (1, 2), positions, normals)
    with pytest.raises(ValueError, match=r"normals of length 2\.000–2\.000, not 1"):
        Skin((SkinPart("nose", "head", (1,), unit_z, 2 * unit_z),))


@pytest.mark.parametrize(("name", "k"), [("palm", None), ("left_palm:99", 13), ("left_forearm:51", 11)])
@pytest.mark.parametrize("n_joints", [4, 7])
def test_position_jacobian_and_normal_of_a_point_of_the_arm(name, k, n_joints):
    """The palm's point is its frame's origin, whose taxels face along −z."""
    skin = icub_skin(("left_forearm", "left_palm"))
    point = EndPoint.of(ROBOT, "left", name, n_joints)
    joints = ROBOT.indices(ROBOT.names.arm("left")[:n_joints])
    q = np.zeros(ROBOT.n_joints)
    arm = np.linspace(0.1, 0.4, n_joints)
    q[joints] = arm
    posture = ROBOT.at(q)
    T = posture.T_root("left_palm")
    expected, normal = (T[:3, 3], -T[:3, 2]) if k is None else (vectors[k] for vectors in skin.at(posture))
    (position,), (J,) = point.positions(arm[None])
    np.testing.assert_allclose(position, expected, atol=1e-12)
    np.testing.assert_allclose(point.normals(arm[None])[0], normal, atol=1e-3)
    h = 1e-6 * np.eye(n_joints)
    differences = (point.positions(arm + h)[0] - point.positions(arm - h)[0]) / 2e-6
    np.testing.assert_allclose(J, differences.T, atol=1e-8)


def test_a_palm_without_taxels_faces_along_its_z_axis():
    point = EndPoint.of(ROBOT, "right", "palm", 7, Skin(icub_skin(("right_forearm",)).parts))
    np.testing.assert_array_equal(point.normal, [0.0, 0.0, 1.0])


def test_what_is_no_point_of_the_arm_is_answered_with_those_that_are():
    for name in ("elbow", "right_forearm:27"):
        with pytest.raises(ValueError, match=f"'{name}' of the left arm; expected palm or one of left_forearm:27, "):
            EndPoint.of(ROBOT, "left", name, 7)

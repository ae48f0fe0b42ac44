"""Mesh files as stimuli: where and how large they appear, and files that hold no object."""

import os
import re
from contextlib import nullcontext

import cv2
import numpy as np
import pytest
import trimesh

from pps_vision.errors import InputError
from pps_vision.geometry.se3 import rotation_to
from rendering.eyes import Eyes
from rendering.scene import PropPose, SceneState
from rendering.shapes import board
from rendering.stimulus_file import load_stimulus

PLACE = np.array([-0.36, -0.06, 0.12])
WEDGE = np.array([[0, 0, 0], [80, 0, 0], [0, 50, 0], [80, 50, 0], [0, 0, 60], [0, 50, 60.0]])  # mm


def wedge() -> trimesh.Trimesh:
    return trimesh.convex.convex_hull(WEDGE + np.array([1000.0, 0, 0]))


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply"])
def test_a_mesh_covers_the_hull_of_its_projected_corners(robot, rig, q, tmp_path, suffix):
    """In millimetres and far from its origin; the silhouette against OpenCV's projection and convex hull."""
    file = tmp_path / f"wedge.{suffix}"
    wedge().export(file)
    R = cv2.Rodrigues(np.array([0.4, -0.7, 0.3]))[0]
    with Eyes(robot, rig, load_stimulus(file, "mm")) as eyes:
        empty = eyes.render(SceneState(q), 0.0)
        frame = eyes.render(SceneState(q, PLACE, rotation=R), 0.0)
    # a prism over a right triangle: its centroid is a third along each leg and half way between the triangles
    corners = PLACE + 0.001 * (WEDGE - [80 / 3, 25, 20]) @ R.T
    for side in ("left", "right"):
        view = getattr(rig.view(q), side)
        rvec = cv2.Rodrigues(view.T_camera_root[:3, :3])[0]
        c = view.camera
        px = cv2.projectPoints(corners, rvec, view.T_camera_root[:3, 3], c.K, np.array(c.distortion))[0]
        expected = np.zeros((240, 320), np.uint8)
        cv2.fillConvexPoly(expected, cv2.convexHull(np.rint(16 * px).astype(np.int32)), 1, shift=4)
        changed = np.abs(getattr(frame, side).astype(int) - getattr(empty, side)).max(axis=2) > 20
        assert expected.sum() > 600
        assert (changed & (expected == 0)).sum() + (~changed & (expected == 1)).sum() < 0.06 * expected.sum()
        assert not (changed & (cv2.dilate(expected, np.ones((3, 3))) == 0)).any()


def test_the_radius_is_that_of_the_sphere_with_the_mean_silhouette(tmp_path):
    """By Cauchy's theorem a quarter of the hull's surface; of a sphere its own, of a ring that of the disc it spans."""
    ball = tmp_path / "ball.stl"
    ring = tmp_path / "ring.stl"
    trimesh.creation.icosphere(4, 0.03).export(ball)
    trimesh.creation.annulus(0.02, 0.05, 0.03, sections=128).export(ring)
    assert load_stimulus(ball).radius_m == pytest.approx(0.03, rel=0.003)
    disc_m2 = 2 * np.pi * 0.05**2 + 2 * np.pi * 0.05 * 0.03
    assert load_stimulus(ring).radius_m == pytest.approx(np.sqrt(disc_m2 / (4 * np.pi)), rel=0.003)
    scaled = load_stimulus(ring, "m", radius_m=0.02)
    assert scaled.radius_m == 0.02
    assert scaled.parts[0].mesh.extents[0] == pytest.approx(0.1 * 0.02 / load_stimulus(ring).radius_m)


def test_a_ring_is_hidden_by_what_stands_before_its_hole_only(robot, rig, q, tmp_path):
    trimesh.creation.annulus(0.03, 0.04, 0.01).export(tmp_path / "ring.stl")
    eye = rig.view(q).left
    facing = rotation_to(eye.center - PLACE)
    with Eyes(robot, rig, load_stimulus(tmp_path / "ring.stl"), props=((board(0.02, 0.02),),)) as eyes:
        for share, visible in ((0.2, False), (-0.2, True)):
            props = (PropPose(PLACE + share * (eye.center - PLACE), rotation=facing),)
            assert eyes.truth(SceneState(q, PLACE, rotation=facing, props=props), 0.0).visible_left == visible


@pytest.mark.parametrize("corner", [4, 9, -1])
def test_a_triangle_whose_corner_is_none_of_the_file_is_refused(tmp_path, corner):
    kinds = [f"property float {axis}" for axis in "xyz"]
    header = ["ply", "format ascii 1.0", "element vertex 4", *kinds, "element face 4"]
    header += ["property list uchar int vertex_indices", "end_header"]
    corners = ["0 0 0", "0.1 0 0", "0 0.1 0", "0 0 0.1"]
    faces = ["3 0 2 1", "3 0 1 3", "3 0 3 2"]
    file = tmp_path / "solid.ply"
    file.write_text("\n".join([*header, *corners, *faces, "3 1 2 3", ""]))
    assert len(load_stimulus(file).parts) == 1
    file.write_text("\n".join([*header, *corners, *faces, f"3 1 2 {corner}", ""]))
    with pytest.raises(InputError, match="has triangles without vertices in space"):
        load_stimulus(file)


def test_a_mesh_that_is_inside_out_is_turned_over(tmp_path):
    box = trimesh.creation.box((0.05, 0.06, 0.07))
    box.invert()
    box.export(tmp_path / "box.stl")
    (part,) = load_stimulus(tmp_path / "box.stl").parts
    assert part.mesh.volume == pytest.approx(0.05 * 0.06 * 0.07)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("empty.stl", "", "is empty"),
        ("words.obj", "hello\n", "holds no triangles"),
        ("cut.ply", "ply\n", "cannot be read as PLY"),
        ("index.obj", "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 9\n", "cannot be read as OBJ"),
        ("nan.obj", "v 0 0 nan\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n", "not finite"),
        ("flat.obj", "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n", "lie in a plane"),
        ("model.gltf", "{}", "expected a mesh file"),
    ],
)
def test_a_file_without_an_object_is_named_in_one_line(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message) as error:
        load_stimulus(tmp_path / name)
    assert str(error.value).startswith(str(tmp_path / name))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("size_mm", "fits"), [(1.8, False), (2.2, True), (580, True), (620, False)])
def test_an_object_fits_the_eyes_view(size_mm, fits, tmp_path):
    """Of 2 mm to 0.6 m; one that is told its radius is scaled."""
    file = tmp_path / "box.stl"
    trimesh.creation.box((size_mm, 0.5 * size_mm, 0.5 * size_mm)).export(file)
    with nullcontext() if fits else pytest.raises(InputError, match=r"expected 0\.002 to 0\.6 m"):
        load_stimulus(file, "mm")
    assert load_stimulus(file, "mm", 0.03).radius_m == pytest.approx(0.03)


@pytest.mark.parametrize(("unit", "m"), [("m", 1.0), ("cm", 0.01), ("mm", 0.001)])
def test_a_file_is_in_its_unit(unit, m, tmp_path):
    trimesh.creation.box((0.04 / m, 0.05 / m, 0.06 / m)).export(tmp_path / "box.STL")
    (part,) = load_stimulus(tmp_path / "box.STL", unit).parts
    assert part.mesh.extents == pytest.approx([0.04, 0.05, 0.06])


def test_materials_are_files_and_textures_are_not_read(tmp_path):
    """The material's colour counts, not the texture of 100 megapixels; a pipe in its place is not waited for."""
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 1 0 0\nmap_Kd large.png\n")
    (tmp_path / "large.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    text = re.sub(r"(?m)( \d+)(?= |$)", r"\1/1", trimesh.creation.box((0.04, 0.05, 0.06)).export(file_type="obj"))
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\nvt 0 0\nusemtl red\n{text}")
    assert load_stimulus(tmp_path / "a.obj").parts[0].color == (1, 0, 0)
    (tmp_path / "a.mtl").unlink()
    os.mkfifo(tmp_path / "a.mtl")
    load_stimulus(tmp_path / "a.obj")

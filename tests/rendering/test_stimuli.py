"""Stimuli, carriers and the solids they are made of."""

from typing import get_args

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pps_vision.types import Array
from rendering.names import StimulusName
from rendering.stimuli import Stimulus, carrier_parts, carrier_pose, make_stimulus


def silhouettes(stimulus: Stimulus, n: int = 60) -> tuple[float, Array]:
    """Mean area (m²) and centre (3,) of the shadows that parallel light throws, from all around."""
    scale = 150 / (2 * stimulus.radius_m)
    areas = []
    centers = []
    for R in Rotation.random(n, rng=np.random.default_rng(0)).as_matrix():
        shadow = np.zeros((301, 301), np.uint8)
        for part in stimulus.parts:
            xy = (part.mesh.vertices @ R)[:, :2] * scale + 150
            for triangle in np.rint(xy[part.mesh.faces] * 16).astype(np.int32):
                cv2.fillConvexPoly(shadow, triangle, 1, shift=4)
        v, u = np.nonzero(shadow)
        areas.append(len(u) / scale**2)
        centers.append(R[:, :2] @ (np.array([u.mean(), v.mean()]) - 150) / scale)
    return float(np.mean(areas)), 1.5 * np.mean(centers, axis=0)  # two of three axes are seen each time


@pytest.mark.parametrize("name", get_args(StimulusName))
def test_the_silhouette_is_that_of_the_sphere_that_stands_for_it(name):
    stimulus = make_stimulus(name)
    area, center = silhouettes(stimulus)
    assert np.sqrt(area / np.pi) == pytest.approx(stimulus.radius_m, rel=0.03)
    assert np.linalg.norm(center) < 0.05 * stimulus.radius_m


def test_a_cube_has_a_yellow_lid_and_base_and_blue_sides():
    """A cube of the side whose surface is four times the sphere's silhouette: 6 s² = 4 π r²."""
    colors = {part.color: part.mesh for part in make_stimulus("cube", 0.03).parts}
    side = 0.03 * np.sqrt(4 * np.pi / 6)
    assert len(colors) == 2
    for color, mesh in colors.items():
        upward = np.abs(mesh.face_normals[:, 2]) > 0.5
        assert (upward.all(), (~upward).all()) == (color[0] > 0.5, color[2] > 0.5)
        assert mesh.bounds == pytest.approx(side / 2 * np.array([[-1, -1, -1], [1, 1, 1]]))
        assert mesh.area == pytest.approx((2 if color[0] > 0.5 else 4) * side**2)


@pytest.mark.parametrize("name", get_args(StimulusName))
def test_every_surface_faces_outward(name):
    stimulus = make_stimulus(name)
    parts = [
        *stimulus.parts,
        *carrier_parts("hand", stimulus.radius_m, 3),
        *carrier_parts("stick", stimulus.radius_m, 3),
    ]
    for part in parts:
        if len(part.mesh.faces) > 10:  # the cube's two colours are open sheets
            assert part.mesh.is_watertight
            assert part.mesh.volume > 0
        normals = part.mesh.face_normals
        assert np.einsum("ij,ij->", normals, part.mesh.triangles_center - part.mesh.centroid) > 0


@pytest.mark.parametrize("radius", [0.010, 0.035, 0.100])
@pytest.mark.parametrize("name", ["stick", "hand"])
def test_a_carrier_reaches_away_and_leaves_the_near_half_free(name, radius):
    vertices = np.vstack([part.mesh.vertices for part in carrier_parts(name, radius, 3)])
    assert vertices[:, 2].max() > 0.5
    assert vertices[:, 2].min() >= 0
    gap = np.linalg.norm(vertices, axis=1).min() - radius
    assert gap < 0.002  # it holds the object


@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (0.0, 0.0, -2.0), (-0.75, 0.25, 0.61), (1.0, 0.0, 0.0)])
def test_a_carrier_stands_where_it_is_told(direction):
    T = carrier_pose((0.1, 0.2, 0.3), direction)
    assert T[:3, 2] == pytest.approx(np.array(direction) / np.linalg.norm(direction))
    assert T[:3, 3] == pytest.approx([0.1, 0.2, 0.3])
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1)
    assert T[:3, :3].T @ T[:3, :3] == pytest.approx(np.eye(3), abs=1e-12)
    if np.abs(T[2, 2]) < 1:
        assert T[2, 1] == pytest.approx(np.sqrt(1 - T[2, 2] ** 2))  # the back of the hand is as far up as it can be

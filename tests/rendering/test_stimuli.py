"""Stimuli, carriers and the solids they are made of."""

from typing import get_args

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pps_vision.robot.model import Body
from pps_vision.types import Array
from rendering.carriers import carrier_parts, carrier_pose
from rendering.names import StimulusName
from rendering.shapes import board, body_part, sphere, surface_of, tube
from rendering.stimuli import Stimulus, make_stimulus


def silhouettes(stimulus: Stimulus, n: int = 60) -> tuple[float, Array]:
    """Mean area (m²) and centre (3,) of the shadows that parallel light throws, from all around."""
    scale, areas, centers = 150 / (2 * stimulus.radius_m), [], []
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
def test_the_silhouette_is_that_of_the_sphere_that_stands_for_it(name: StimulusName) -> None:
    stimulus = make_stimulus(name)
    area, center = silhouettes(stimulus)
    assert np.sqrt(area / np.pi) == pytest.approx(stimulus.radius_m, rel=0.03)
    assert np.linalg.norm(center) < 0.05 * stimulus.radius_m


@pytest.mark.parametrize("name", get_args(StimulusName))
def test_another_radius_scales_the_whole(name: StimulusName) -> None:
    usual, double = make_stimulus(name), make_stimulus(name, 2 * make_stimulus(name).radius_m)
    for small, large in zip(usual.parts, double.parts, strict=True):
        assert np.allclose(large.mesh.vertices, 2 * small.mesh.vertices, atol=1e-12)


def test_an_octopus_is_the_same_on_both_sides_of_its_face() -> None:
    eyes = [part.mesh for part in make_stimulus("octopus").parts if max(part.color) == min(part.color)]
    both = np.sort([mesh.vertices * (1, np.sign(mesh.centroid[1]), 1) for mesh in eyes], axis=1)
    assert len(eyes) == 4
    assert [mesh.centroid[1] > 0 for mesh in eyes] in ([False, False, True, True], [True, True, False, False])
    np.testing.assert_allclose(both[:2], both[2:], atol=1e-4)


def test_a_cube_has_a_yellow_lid_and_base_and_blue_sides() -> None:
    """A cube of the side whose surface is four times the sphere's silhouette: 6 s² = 4 π r²."""
    colors = {part.color: part.mesh for part in make_stimulus("cube", 0.03).parts}
    side = 0.03 * np.sqrt(4 * np.pi / 6)
    assert len(colors) == 2
    for color, mesh in colors.items():
        upward = np.abs(mesh.face_normals[:, 2]) > 0.5
        assert (upward.all(), (~upward).all()) == (color[0] > 0.5, color[2] > 0.5)
        assert mesh.bounds == pytest.approx(side / 2 * np.array([[-1, -1, -1], [1, 1, 1]]))
        assert mesh.area == pytest.approx((2 if color[0] > 0.5 else 4) * side**2)


@pytest.mark.parametrize(("name", "color"), [("ball", 0), ("marker", 1)])
def test_a_ball_is_a_sphere_of_one_colour_about_the_origin(name: StimulusName, color: int) -> None:
    (part,) = make_stimulus(name, 0.03).parts
    away = np.linalg.norm(part.mesh.vertices, axis=1)
    assert away == pytest.approx(np.full(len(away), away[0]))
    assert part.mesh.area == pytest.approx(4 * np.pi * 0.03**2)
    assert len(part.mesh.faces) == 20 * 4**3
    assert int(np.argmax(part.color)) == color


def test_an_octopus_has_eight_equal_arms_below_a_violet_head() -> None:
    """The arms are one another turned by 45° about the head's axis; they thin out, and reach far beyond the head."""
    parts = make_stimulus("octopus", 0.04).parts
    arms = [part.mesh for part in parts if part.color[0] > 0.9 and part.color[1] < 0.9]
    (head,) = (part.mesh for part in parts if part.color[2] > 0.8 and part.color[1] < 0.5)
    assert len(arms) == 8
    for k, arm in enumerate(arms):
        turned = Rotation.from_euler("z", 45 * k, degrees=True).apply(arms[0].center_mass)
        assert arm.center_mass == pytest.approx(turned, abs=2e-4)
        assert arm.volume == pytest.approx(arms[0].volume, rel=0.02)
        assert np.linalg.norm(arm.vertices[:, :2], axis=1).max() == pytest.approx(0.0568, abs=0.001)
    (x0, y0, z0), (x1, y1, z1) = head.bounds
    assert x1 - x0 == pytest.approx(y1 - y0)
    assert 1 < (z1 - z0) / (x1 - x0) < 1.2
    assert max(arm.vertices[:, 2].max() for arm in arms) < z1 - 0.6 * (z1 - z0)
    reach = np.linalg.norm(arms[0].vertices[:, :2], axis=1)
    assert reach.max() > 1.7 * x1
    height = [np.ptp(arms[0].vertices[close, 2]) for close in (reach < 0.3 * reach.max(), reach > 0.93 * reach.max())]
    assert height[1] < 0.7 * height[0]
    middle, half = head.bounds.mean(axis=0), np.ptp(head.bounds, axis=0) / 2
    eyes = [part for part in parts if max(part.color) == min(part.color)]
    for part in eyes:
        within = np.linalg.norm((part.mesh.vertices - middle) / half, axis=1)
        assert within.min() < 1 < within.max()  # on the head, half sunk in
        assert part.mesh.vertices[:, 0].min() > 0.5 * x1  # in front
    for pupil, eye in ((eyes[1], eyes[0]), (eyes[3], eyes[2])):
        assert max(pupil.color) < 0.1 < min(eye.color)
        assert pupil.mesh.extents.max() < 0.7 * eye.mesh.extents.max()
        assert pupil.mesh.bounds[1, 0] > eye.mesh.bounds[1, 0] > pupil.mesh.bounds[0, 0]


def test_usual_sizes() -> None:
    assert [make_stimulus(n).radius_m for n in ("marker", "ball", "cube", "octopus")] == [0.010, 0.035, 0.030, 0.040]


@pytest.mark.parametrize("name", get_args(StimulusName))
def test_colours_are_saturated(name: StimulusName) -> None:
    area = {}
    for part in make_stimulus(name).parts:
        rgb = np.float32([[part.color]])
        is_vivid = cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV)[0, 0, 1] > 0.85 and max(part.color) > 0.8
        area[is_vivid] = area.get(is_vivid, 0.0) + part.mesh.area
    assert area[True] > 0.9 * sum(area.values())  # the octopus's eyes are not


@pytest.mark.parametrize("name", get_args(StimulusName))
def test_every_surface_faces_outward(name: StimulusName) -> None:
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


def test_a_straight_tube_has_the_volume_of_a_capsule() -> None:
    part = tube([[0, 0, 0], [0, 0, 0.05], [0, 0, 0.1]], 0.01, (1, 1, 1), sides=64)
    assert part.mesh.volume == pytest.approx(np.pi * 1e-4 * 0.1 + 4 / 3 * np.pi * 1e-6, rel=0.01)
    assert part.mesh.extents == pytest.approx([0.02, 0.02, 0.12], rel=0.01)


def test_a_tapered_tube_ends_in_half_balls_of_its_end_radii() -> None:
    part = tube([[0, 0, 0], [0, 0, 0.05], [0, 0, 0.1]], [0.01, 0.015, 0.03], (1, 1, 1), sides=8)
    assert part.mesh.bounds[:, 2] == pytest.approx([-0.01, 0.13])


def test_a_bent_tube_follows_its_path() -> None:
    turn = np.linspace(0, np.pi / 2, 30)
    part = tube(0.1 * np.column_stack([np.cos(turn), np.sin(turn), 0 * turn]), 0.01, (1, 1, 1), sides=32)
    # Pappus: cross section times the way of its centre, and the two half balls
    assert part.mesh.volume == pytest.approx(np.pi * 1e-4 * 0.1 * np.pi / 2 + 4 / 3 * np.pi * 1e-6, rel=0.02)


@pytest.mark.parametrize("radius", [0.010, 0.035, 0.100])
@pytest.mark.parametrize("name", ["stick", "hand"])
def test_a_carrier_reaches_away_and_leaves_the_near_half_free(name: str, radius: float) -> None:
    vertices = np.vstack([part.mesh.vertices for part in carrier_parts(name, radius, 3)])  # type: ignore[arg-type]
    assert vertices[:, 2].max() > 0.5
    assert vertices[:, 2].min() >= 0
    gap = np.linalg.norm(vertices, axis=1).min() - radius
    assert gap < 0.002  # it holds the object


@pytest.mark.parametrize("radius", [0.010, 0.035])
def test_a_stick_is_a_straight_thin_rod_from_within_the_object(radius: float) -> None:
    (stick,) = (part.mesh for part in carrier_parts("stick", radius, 3))
    assert stick.bounds[:, 2] == pytest.approx([0.5 * radius - 0.005, 0.705])
    assert stick.bounds[:, :2] == pytest.approx(0.005 * np.array([[-1, -1], [1, 1]]))
    assert carrier_parts("none", radius, 3) == ()


@pytest.mark.parametrize("radius", [0.010, 0.035])
def test_a_hand_holds_with_four_fingers_above_and_a_thumb_below(radius: float) -> None:
    """Fingers about as thick as an adult's (1.6 cm), which touch the object but do not enter it by more than 2.5 mm;
    behind them palm, wrist and sleeve in line."""
    palm, *fingers, thumb, wrist, sleeve = (part.mesh for part in carrier_parts("hand", radius, 3))
    assert len(fingers) == 4
    assert [np.sign(finger.center_mass[1]) for finger in fingers] == [1, 1, 1, 1]
    assert thumb.center_mass[1] < 0
    across = [finger.center_mass[0] for finger in fingers]
    assert across == sorted(across, reverse=True)
    assert np.array(across) == pytest.approx(-np.array(across[::-1]), abs=0.004)  # two on each side
    for finger in (*fingers, thumb):
        gap = np.linalg.norm(finger.vertices, axis=1).min() - radius
        assert -0.0025 < gap < 0.0025
        assert finger.volume == pytest.approx(np.pi * 0.008**2 * finger.area / (2 * np.pi * 0.008), rel=0.25)
        tip, knuckle = finger.vertices[np.argsort(finger.vertices[:, 2])[[0, -1]]]
        assert np.linalg.norm(knuckle[:2]) < 0.05
        assert palm.bounds[0, 2] < knuckle[2] < palm.bounds[1, 2] + 0.02
        assert 0 <= tip[2] < knuckle[2]
    assert palm.extents == pytest.approx([0.084, 0.042, 0.1], rel=0.02)  # an adult's palm
    assert np.abs(palm.center_mass[:2]).max() < 1e-3
    for near, far in ((palm, wrist), (wrist, sleeve)):
        assert near.bounds[0, 2] < far.bounds[0, 2] < near.bounds[1, 2] < far.bounds[1, 2]
        assert np.abs(far.center_mass[:2]).max() < 1e-3
    assert 0.04 < wrist.extents[0] < 0.06 < sleeve.extents[0] < 0.11
    assert sleeve.extents[2] == pytest.approx(0.7, abs=0.1)


@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (0.0, 0.0, -2.0), (-0.75, 0.25, 0.61), (1.0, 0.0, 0.0)])
def test_a_carrier_stands_where_it_is_told(direction: tuple[float, float, float]) -> None:
    T = carrier_pose((0.1, 0.2, 0.3), direction)
    assert T[:3, 2] == pytest.approx(np.array(direction) / np.linalg.norm(direction))
    assert T[:3, 3] == pytest.approx([0.1, 0.2, 0.3])
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1)
    assert T[:3, :3].T @ T[:3, :3] == pytest.approx(np.eye(3), abs=1e-12)
    if np.abs(T[2, 2]) < 1:
        assert T[2, 1] == pytest.approx(np.sqrt(1 - T[2, 2] ** 2))  # the back of the hand is as far up as it can be


def test_senseless_things_are_refused() -> None:
    with pytest.raises(ValueError, match=r"stimulus: 'whale'.*marker"):
        make_stimulus("whale")  # type: ignore[arg-type]
    for radius in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="radius"):
            make_stimulus("ball", radius)
    with pytest.raises(ValueError, match=r"carrier 'drone'.*none, stick, hand"):
        carrier_parts("drone", 0.03, 3)  # type: ignore[arg-type]


@pytest.mark.parametrize("sides", [4, 8, 9])
def test_a_tube_has_evenly_spaced_sides(sides: int) -> None:
    """A prism of a regular polygon between its ends: n/2 sin(2π/n) r² of cross section, and each corner once."""
    part = tube([[0, 0, 0], [0, 0, 0.5], [0, 0, 1.0]], 0.01, (1, 1, 1), sides)
    ring = part.mesh.vertices[np.isclose(part.mesh.vertices[:, 2], 0.5)]
    assert len(ring) == sides
    angles = np.sort(np.arctan2(ring[:, 1], ring[:, 0]))
    np.testing.assert_allclose(np.diff(angles), 2 * np.pi / sides)
    np.testing.assert_allclose(np.linalg.norm(ring, axis=1), np.hypot(0.5, 0.01))
    assert part.mesh.volume == pytest.approx(sides / 2 * np.sin(2 * np.pi / sides) * 1e-4, rel=0.02)


def test_a_board_lies_about_the_origin_with_normal_z() -> None:
    assert board(0.1, 0.2).mesh.bounds == pytest.approx(np.array([[-0.05, -0.1, -0.0015], [0.05, 0.1, 0.0015]]))


def test_a_surface_has_the_triangles_of_its_parts_in_their_colours() -> None:
    """A ball has smooth normals, a cube four of the same at each of its faces."""
    ball, box = sphere(0.1, (1.0, 0.0, 0.0), (0.5, 0.0, 0.0)), board(0.1, 0.2, (0.0, 1.0, 0.0))
    whole = surface_of([ball, box])
    corners, colors, normals = (a[whole.faces] for a in (whole.positions, whole.colors, whole.normals))
    expected = np.concatenate([ball.mesh.triangles, box.mesh.triangles])
    assert sorted(corners.round(9).tolist()) == sorted(expected.round(9).tolist())
    is_ball = corners[:, :, 0] > 0.3
    assert (is_ball == is_ball[:, :1]).all()
    assert is_ball[:, 0].sum() == len(ball.mesh.faces)
    np.testing.assert_array_equal(colors, np.where(is_ball[..., None], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    np.testing.assert_allclose(normals[is_ball], 10 * (corners[is_ball] - [0.5, 0, 0]), atol=0.02)
    assert np.sort(np.abs(normals[~is_ball]), axis=1) == pytest.approx(np.tile([0.0, 0.0, 1.0], (36, 1)), abs=1e-9)
    assert whole.bounds == pytest.approx(np.array([[-0.05, -0.1, -0.1], [0.6, 0.1, 0.1]]), abs=2e-3)


@pytest.mark.parametrize("shape", ["sphere", "cylinder", "box"])
def test_a_bodys_mesh_has_its_size_and_pose(shape: str) -> None:
    size = {"sphere": (0.05,), "cylinder": (0.03, 0.2), "box": (0.1, 0.2, 0.3)}[shape]
    half = {"sphere": (0.05,) * 3, "cylinder": (0.03, 0.03, 0.1), "box": (0.05, 0.1, 0.15)}[shape]
    pose = np.array([[0, -1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, 1, 0.3], [0, 0, 0, 1.0]])  # a quarter turn about z
    body = Body("palm_0", "palm", shape, size, pose, (0.1, 0.2, 0.3))  # type: ignore[arg-type]
    part = body_part(body, 4)
    expected = np.array([0.1, 0.2, 0.3]) + np.outer([-1, 1], [half[1], half[0], half[2]])
    assert part.mesh.bounds == pytest.approx(expected, abs=0.001)
    assert part.color == (0.1, 0.2, 0.3)


@pytest.mark.parametrize(("fineness", "as_fine_as"), [(4, 3), (1, 0), (0, 0)])
def test_a_bodys_sphere_is_a_level_coarser_than_a_stimulus(fineness: int, as_fine_as: int) -> None:
    body = Body("palm_0", "palm", "sphere", (0.05,), np.eye(4), (0.1, 0.2, 0.3))
    own, stimulus = body_part(body, fineness).mesh, sphere(0.05, (0.1, 0.2, 0.3), fineness=as_fine_as).mesh
    assert len(own.faces) == len(stimulus.faces) == 20 * 4**as_fine_as

"""The ray caster and its films against closed forms, OpenCV and the robot's published geometry."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from tracks import track_at

from pps_vision.experiments.baselines.image_trackers import sphere_box
from pps_vision.experiments.films.caster import (
    AMBIENT,
    LIGHT,
    Ball,
    FilmLens,
    Paint,
    Panel,
    RayCaster,
    SensorChain,
    Solids,
    light_of,
    noise_tape,
    visible_share,
)
from pps_vision.experiments.films.scenes import EYES_AT_REST, Film, FilmScene, head_pose, lenses
from pps_vision.experiments.films.score import score, score_of_film
from pps_vision.types import Array, Status, Track3D

NOWHERE = Path("no such folder")  # every photograph a procedural texture
BENT = np.array([-0.12, 0.05, 0.0006, -0.0004, 0.0])
LENS = FilmLens(160, 120, np.array([[140.0, 0, 78.2], [0, 141.0, 61.3], [0, 0, 1]]), BENT)
WHITE = Paint((255.0, 255.0, 255.0))
BLACK = Paint((0.0, 0.0, 0.0))
HERE = np.eye(4)


def coverage(lens: FilmLens, solids: Solids) -> np.ndarray:
    """(h, w) share of each pixel that lies on black solids before a lit room."""
    room = RayCaster(lens, 0, NOWHERE)
    room._walls = np.full_like(room._walls, 255.0)
    return 1 - room.light([HERE], [solids])[..., 0] / 255


def centroid(weights: np.ndarray) -> np.ndarray:
    """x and y (px) of the mean of an image."""
    v, u = np.mgrid[: weights.shape[0], : weights.shape[1]]
    return np.array([(u * weights).sum(), (v * weights).sum()]) / weights.sum()


def test_a_ball_covers_the_ellipse_of_its_silhouette():
    """Without distortion the silhouette is a conic: p Q p = 0 with Q = K⁻ᵀ(c cᵀ − (|c|² − r²)I)K⁻¹."""
    lens = replace(LENS, distortion=np.zeros(5))
    c = np.array([0.09, -0.05, 0.5])
    r = 0.06
    inverse = np.linalg.inv(lens.K)
    Q = inverse.T @ (np.outer(c, c) - (c @ c - r * r) * np.eye(3)) @ inverse
    middle = -np.linalg.solve(Q[:2, :2], Q[:2, 2])
    area = np.pi * (Q[2, 2] + Q[:2, 2] @ middle) / np.sqrt(np.linalg.det(Q[:2, :2])) * -np.sign(np.trace(Q[:2, :2]))
    share = coverage(lens, (Ball(c, r, BLACK),))
    assert share.sum() == pytest.approx(area, rel=2e-3)
    np.testing.assert_allclose(centroid(share), middle, atol=0.02)
    assert np.linalg.norm(middle - (lens.K @ c / c[2])[:2]) > 0.1, "not where the centre projects"


def test_a_panel_s_corners_are_where_opencv_projects_them():
    """Through a distorting lens, to the area of the quadrilateral with bent edges."""
    panel = Panel(np.array([0.05, 0.02, 0.6]), np.array([0.1, 0.01, 0.05]), np.array([-0.007, 0.07, 0.0]), BLACK)
    s = np.linspace(-1, 1, 200)[:, None]
    edges = [(s, -1 + 0 * s), (1 + 0 * s, s), (-s, 1 + 0 * s), (-1 + 0 * s, -s)]
    rim = np.concatenate([panel.center + a * panel.right + b * panel.down for a, b in edges])
    pixels = cv2.projectPoints(rim, np.zeros(3), np.zeros(3), LENS.K, BENT)[0].astype(np.float32)
    share = coverage(LENS, (panel,))
    assert share.sum() == pytest.approx(cv2.contourArea(pixels), rel=2e-3)
    moments = cv2.moments(pixels)
    middle = [moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]]
    np.testing.assert_allclose(centroid(share), middle, atol=0.02)


def test_truth_is_what_opencv_projects():
    """Of both eyes of a fixed rig, root frame the left eye."""
    scene = FilmScene(seconds=0.2, start="moving")
    film = Film(scene, 3, NOWHERE)
    for row in film.truth:
        for lens, shift, pixel in zip(lenses(scene), (0.0, -0.12), (row.left_px, row.right_px), strict=True):
            p = row.position + np.array([shift, 0, 0])
            exact = cv2.projectPoints(p, np.zeros(3), np.zeros(3), lens.K, lens.distortion)[0].ravel()
            np.testing.assert_allclose(pixel, exact, atol=1e-6)
    np.testing.assert_allclose(
        (film.truth[2].position - film.truth[0].position) * scene.fps / 2, film.truth[1].velocity, atol=2e-3
    )


def test_nearer_solids_occlude():
    far = Ball(np.array([0, 0, 0.8]), 0.08, WHITE)
    near = Ball(np.array([0.05, 0, 0.4]), 0.05, Paint((200.0, 0, 0)))
    image = RayCaster(LENS, 0, NOWHERE).light([HERE], [(near, far)])
    swapped = RayCaster(LENS, 0, NOWHERE).light([HERE], [(far, near)])
    np.testing.assert_array_equal(image, swapped)
    u, v = np.rint(LENS.project(HERE, near.center)[0]).astype(int)
    lambert = AMBIENT + (1 - AMBIENT) * (LIGHT @ (-near.center / np.linalg.norm(near.center)))
    np.testing.assert_allclose(image[v, u], [255 * ((200 / 255 + 0.055) / 1.055) ** 2.4 * lambert, 0, 0], rtol=0.02)
    board = Panel(np.array([-0.5, 0, 0.5]), np.array([0.5, 0, 0]), np.array([0, 1.0, 0]), WHITE)  # up to x = 0
    assert visible_share(LENS, HERE, (far, board), far) == pytest.approx(0.5, abs=0.02)
    assert visible_share(LENS, HERE, (far,), far) == 1.0


def test_light_adds_before_the_tone_curve(rng):
    """Full light and none, blurred: 188 of 255 levels (sRGB) where both have the same share."""
    light = np.zeros((40, 40, 3), np.float32)
    light[:, 20:] = 255.0
    image = SensorChain(defocus_px=3.0, read_noise=0.0).expose(light, 1.0, rng, noise_tape(rng))
    assert np.interp(19.5, [19, 20], image[20, 19:21, 0]) == pytest.approx(188, abs=2)
    levels = np.tile(np.arange(256, dtype=np.float32)[:, None, None], (1, 2, 3))
    again = SensorChain(read_noise=0.0).expose(light_of(levels), 1.0, rng, noise_tape(rng))
    np.testing.assert_allclose(again, levels, atol=1)


def test_motion_blur_is_as_long_as_the_path_in_the_exposure():
    """A disc's variance along its motion grows by length²/12; its centre and its variance across stay."""
    lens = replace(LENS, distortion=np.zeros(5))
    scenes = [(Ball(np.array([x, 0, 0.5]), 0.04, WHITE),) for x in np.linspace(-0.5, 0.5, 16) * 0.1 * 15 / 16]
    caster = RayCaster(lens, 0, NOWHERE)
    caster._walls = np.zeros_like(caster._walls)
    blurred = caster.light([HERE] * 16, scenes)[..., 0]
    sharp = caster.light([HERE], [(Ball(np.array([0, 0, 0.5]), 0.04, WHITE),)])[..., 0]
    v, u = np.mgrid[: lens.height, : lens.width]
    x, x0 = (centroid(image)[0] for image in (blurred, sharp))
    assert x == pytest.approx(x0, abs=0.06)
    along, along0 = ((image * (u - x) ** 2).sum() / image.sum() for image in (blurred, sharp))
    assert along - along0 == pytest.approx((0.1 / 0.5 * 140) ** 2 / 12, rel=0.03)
    y0 = centroid(sharp)[1]
    across, across0 = ((image * (v - y0) ** 2).sum() / image.sum() for image in (blurred, sharp))
    assert across == pytest.approx(across0, rel=0.01)


def test_the_head_is_the_icub_s():
    """Heights and fixation point by iKin's tables."""
    left, right = head_pose({}, "left"), head_pose({}, "right")
    assert left[2, 3] == pytest.approx(0.3408, abs=1e-6)
    np.testing.assert_allclose(right[:3, 3] - left[:3, 3], [0, 0.068, 0], atol=1e-9)
    np.testing.assert_allclose(0.5 * (left + right)[:3, 3], EYES_AT_REST, atol=1e-6)
    half = np.deg2rad(10)
    left, right = head_pose({"left_eye_pan": half}, "left"), head_pose({"right_eye_pan": -half}, "right")
    s = np.linalg.lstsq(np.stack([left[:3, 2], -right[:3, 2]], axis=1), right[:3, 3] - left[:3, 3], rcond=None)[0]
    np.testing.assert_allclose(left[:3, 3] + s[0] * left[:3, 2], [-0.2556, 0, 0.3408], atol=1e-4)


def test_stale_poses_are_as_old_as_asked_and_the_images_are_not():
    fresh = Film(FilmScene(rig="head", seconds=0.2, width=64, height=48), 5, NOWHERE)
    stale = Film(replace(fresh.scene, stale_s=0.02), 5, NOWHERE)
    for frame, late in zip(fresh, stale, strict=True):
        np.testing.assert_array_equal(frame.left, late.left)
        np.testing.assert_allclose(late.joints_left_rad, fresh.joints(frame.stamp_s - 0.02), atol=1e-12)
    view = fresh.rig.view(fresh.joints(0.1))
    for row in (row for row in fresh.truth if row.stamp_s == pytest.approx(0.1)):
        np.testing.assert_allclose(view.left.project(row.position), row.left_px, atol=1e-3)


@pytest.mark.parametrize("known", [True, False])
def test_a_rotating_rig_is_told_only_where_it_is_known(known):
    film = Film(FilmScene(rig="rotating", rig_known=known, seconds=1.0, start="moving"), 6, NOWHERE)
    row = film.truth[15]  # a quarter of the period: turned by 1°
    off = np.linalg.norm(film.rig.view(film.joints(row.stamp_s)).left.project(row.position) - row.left_px)
    assert off < 1e-3 if known else off > 5


def test_scores_count_what_they_say():
    film = Film(FilmScene(start="moving", seconds=2.0, fps=10.0), 1, NOWHERE)

    def track(k: int, off_m: float, status: Status = Status.TRACKING) -> Track3D:
        row = film.truth[k]
        return track_at(row.position + np.array([off_m, 0, 0]), stamp_s=row.stamp_s, cov=1e-4, status=status)

    tracks = [track(k, 0.01) for k in range(20)]
    tracks[12:16] = [track(12, 0.04), track(13, 0.06), track(14, 0.001, Status.COASTING), Track3D.unknown(1.5)]
    assert score(tracks, film.truth) == {
        "judged": 10,
        "right_percent": 60,  # neither too far off nor without the claim
        "false_percent": 5,  # of all frames
        "found_s": 0,
        "known_s": 0,
        "known_percent": 100,
        "median_mm": pytest.approx(10),
        "radius_percent": pytest.approx(0, abs=1e-9),
        "covered_percent": 75,  # of eight claims two are 4 and 6 σ off
    }
    late = [Track3D.unknown(row.stamp_s) for row in film.truth[:7]] + tracks[7:]
    assert score(late, film.truth)["found_s"] == pytest.approx(0.7)
    late[7:10] = [track(k, 0.031) for k in range(7, 10)]  # not right
    late_of_moving = score([replace(row, radius_m=0.033) for row in late], film.truth, 0.5)
    assert late_of_moving["known_percent"] == 100, "0.2 s after it moves, 31 mm off, 5 % of the distance"
    assert late_of_moving["found_s"] == pytest.approx(0.5), "from 0.5 s, when it moves, to 1.0 s"
    assert late_of_moving["judged"] == 5
    assert late_of_moving["radius_percent"] == pytest.approx(10)
    nothing = score([Track3D.unknown(row.stamp_s) for row in film.truth], film.truth)
    assert nothing["right_percent"] == nothing["false_percent"] == 0
    assert np.isnan(nothing["median_mm"])


def test_either_of_two_equal_balls_may_be_tracked_but_only_one():
    film = Film(FilmScene(start="moving", seconds=2.0, fps=10.0, second_ball=True), 1, NOWHERE)
    first, second = (np.array([row.position for row in truth]) for truth in film.truths)
    middle = 0.5 * (first + second)
    assert np.ptp(middle, axis=0).max() < 1e-9  # the second mirrors the first, 15 cm farther away
    rates = [np.array([row.velocity for row in truth]) for truth in film.truths]
    np.testing.assert_allclose(rates[1][1:-1], (second[2:] - second[:-2]) / 0.2, atol=0.02)

    def shares(path: Array) -> tuple[float, float]:
        scores = score_of_film([[track] for track in tracks_along(path)], film.truths)
        return scores["right_percent"], scores["false_percent"]

    def tracks_along(path: Array) -> list[Track3D]:
        return [track_at(p, stamp_s=row.stamp_s, cov=1e-4) for row, p in zip(film.truth, path, strict=True)]

    assert shares(second) == (100, 0)
    assert shares(np.concatenate([first[:14], second[14:]])) == (60, 70)
    assert shares(middle) == (0, 100), "the left eye's ball paired with the right eye's other"
    both = list(zip(tracks_along(first), tracks_along(second), strict=True))
    one_and_none = [pair if k < 12 else pair[:1] for k, pair in enumerate(both)]
    assert score_of_film(both, film.truths, each=True)["right_percent"] == 100
    assert score_of_film(one_and_none, film.truths, each=True)["right_percent"] == 20


def test_first_boxes_are_those_of_the_silhouette():
    """Of a ball, the rim's; given in the first frame in which both eyes see the whole object."""
    film = Film(FilmScene(fps=10.0), 3, NOWHERE)
    k, boxes = film.first_boxes
    assert film.share[k].min() >= 0.99 > film.share[k - 1].min()
    views = film.rig.view(None)
    for view, box in zip((views.left, views.right), boxes, strict=True):
        exact = sphere_box(view, film.truth[k].position, film.truth[k].radius_m)
        assert exact is not None
        np.testing.assert_allclose(box, exact, atol=0.2)

"""Triangulation against the known point, OpenCV's linear method and Monte Carlo."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pps_vision.geometry.camera import Camera, StereoRig, StereoView
from pps_vision.geometry.se3 import transform
from pps_vision.geometry.triangulation import midpoint, triangulate
from pps_vision.robot.icub import home, icub_rig, load_icub, set_gaze
from pps_vision.types import Array

ONE_PX = np.eye(2)


@pytest.fixture(scope="module")
def view() -> StereoView:
    robot = load_icub()
    return icub_rig(robot).view(home(robot))


def point_ahead(view: StereoView, rng: np.random.Generator) -> Array:
    in_left = np.array([*rng.uniform(-0.08, 0.08, 2), rng.uniform(0.25, 0.6)])
    return np.asarray((view.left.T_root_camera @ np.append(in_left, 1))[:3])


def test_exact_images_give_back_the_point(view, rng):
    for _ in range(50):
        p = point_ahead(view, rng)
        result = triangulate(view, view.left.project(p), view.right.project(p), ONE_PX, ONE_PX)
        assert result is not None
        np.testing.assert_allclose(result.p_root, p, atol=1e-8)
        assert result.residual_px < 1e-5


def test_it_is_the_least_of_the_weighted_reprojection_errors(rng):
    """SciPy's optimiser, started at the truth, finds no better point: any vergence, lens and unequal noise.

    The covariance is the inverse of the information there, (JᵀJ)⁻¹ with J by finite differences (to the residuals)."""
    robot = load_icub()
    for _ in range(25):
        view = icub_rig(robot).view(set_gaze(robot, home(robot), vergence=rng.uniform(0.0, 0.8)))
        p = point_ahead(view, rng)
        std = 10 ** rng.uniform(-2, 0)
        px = []
        covs = []
        whiten = []
        for eye in (view.left, view.right):
            root = std * (rng.normal(size=(2, 2)) + np.eye(2))
            px.append(eye.project(p) + root @ rng.normal(size=2))
            covs.append(root @ root.T)
            whiten.append(np.linalg.inv(root))

        def error(q: Array, view: StereoView = view, px: list[Array] = px, whiten: list[Array] = whiten) -> Array:
            off = [w @ (m - eye.project(q)) for w, m, eye in zip(whiten, px, (view.left, view.right), strict=True)]
            return np.concatenate(off)

        result = triangulate(view, *px, *covs)
        best = least_squares(error, p, jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15)
        assert result is not None
        np.testing.assert_allclose(result.p_root, best.x, atol=1e-7 * np.sqrt(np.trace(result.cov_root)) + 1e-9)
        assert result.mahalanobis == pytest.approx(2 * best.cost, rel=1e-6, abs=1e-9)
        np.testing.assert_allclose(result.cov_root, np.linalg.inv(best.jac.T @ best.jac), rtol=0.02, atol=1e-12)
        off_px = [eye.project(result.p_root) - m for eye, m in zip((view.left, view.right), px, strict=True)]
        assert result.residual_px == pytest.approx(np.sqrt(np.mean(np.square(off_px))), rel=1e-6, abs=1e-9)


def test_a_pixel_that_no_ray_reaches_gives_none():
    """A barrel lens that folds back 133 px from its middle."""
    folds = Camera(320, 240, 220.0, 220.0, 159.5, 119.5, (-0.4, 0.0, 0.0, 0.0, 0.0))
    view = StereoRig.fixed(folds, folds, transform(translation=(0.068, 0, 0))).view()
    assert triangulate(view, (279.5, 119.5), (259.5, 119.5), ONE_PX, ONE_PX) is not None
    assert triangulate(view, (319.0, 119.5), (259.5, 119.5), ONE_PX, ONE_PX) is None


@pytest.mark.parametrize(
    "lens", [(-0.4, 0, 0, 0, 0), (-1.0, 0, 0, 0, 0), (0, 0, 0, 0, -0.1)], ids=["k1", "large k1", "k3"]
)
def test_what_is_found_through_a_lens_that_folds_back_is_seen_where_it_was_measured(lens, rng):
    """Any pixels: a point is given only if both eyes see it, as far from the pixels as is said; of points that both
    eyes do see, nearly all are found."""
    camera = Camera(320, 240, 220.0, 220.0, 159.5, 119.5, lens)
    n = 600
    n_found = 0
    n_visible = 0
    for k in range(n):
        turned = Rotation.from_euler("y", rng.uniform(-0.2, 0.2)).as_matrix()
        view = StereoRig.fixed(camera, camera, transform(turned, (0.068, 0.0, 0.0))).view()
        left = rng.uniform((-20, -20), (340, 260))
        cov = 10 ** rng.uniform(-4, 1) * np.array([[1.0, 0.3], [0.3, 1.0]])
        right = left + np.array([rng.uniform(-60, 0), np.sqrt(cov[1, 1]) * rng.standard_normal()])
        if k % 2:
            p = rng.uniform((-0.2, -0.2, 0.15), (0.2, 0.2, 0.6))
            left = view.left.project(p)
            right = view.right.project(p)
        visible = bool(k % 2 and np.isfinite([left, right]).all())
        result = triangulate(view, left, right, cov, ONE_PX)
        n_visible += visible
        if result is not None:
            n_found += visible
            off_px = np.array([view.left.project(result.p_root) - left, view.right.project(result.p_root) - right])
            assert result.residual_px == pytest.approx(np.sqrt(np.mean(off_px**2)), abs=1e-4)
    assert n_visible > 0.1 * n
    assert n_found > 0.95 * n_visible


def test_rays_that_cannot_meet_give_none(view):
    parallel = Camera(320, 240, 220.0, 220.0, 159.5, 119.5)
    ahead = StereoRig.fixed(parallel, parallel, transform(translation=(0.068, 0, 0))).view()
    center = (159.5, 119.5)
    assert triangulate(ahead, center, center, ONE_PX, ONE_PX) is None  # at infinity
    assert triangulate(ahead, (100.0, 119.5), (200.0, 119.5), ONE_PX, ONE_PX) is None  # behind the eyes
    assert triangulate(ahead, center, (159.499, 119.5), ONE_PX, ONE_PX) is None  # 15 km away
    assert triangulate(ahead, center, (159.498, 119.5), ONE_PX, ONE_PX) is None  # 7.5 km
    assert triangulate(ahead, center, (159.4976, 119.5), ONE_PX, ONE_PX) is not None  # 6.2 km
    assert triangulate(view, (np.nan, np.nan), (160.0, 120.0), ONE_PX, ONE_PX) is None  # seen by one eye only


@pytest.mark.parametrize("p", [(0.02, 0.0, -0.02), (0.1, 0.0, 0.05)], ids=["left", "right"])
def test_rays_that_meet_behind_one_eye_only_give_none(p):
    """The right eye looks along the baseline towards the left one; a line through a pixel runs on behind the eye."""
    camera = Camera(320, 240, 220.0, 220.0, 159.5, 119.5)
    turned = np.column_stack([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    view = StereoRig.fixed(camera, camera, transform(turned, (0.068, 0.0, 0.0))).view()
    in_eyes = (T @ [*p, 1.0] for T in (view.left.T_camera_root, view.right.T_camera_root))
    left, right = (np.array([220 * x / z + 159.5, 220 * y / z + 119.5]) for x, y, z, _ in in_eyes)
    assert triangulate(view, left, right, ONE_PX, ONE_PX) is None
    in_front = view.left.T_root_camera[:3, :3] @ [0.02, 0.0, 0.02]
    assert triangulate(view, view.left.project(in_front), view.right.project(in_front), ONE_PX, ONE_PX) is not None


def test_midpoint_halves_the_gap_of_skew_rays():
    x, y, z = np.eye(3)
    np.testing.assert_allclose(midpoint(-x, x, 0.2 * z - y, y), [0.0, 0.0, 0.1])
    assert midpoint(-x, -x, 0.2 * z - y, y) is None
    assert midpoint(-x, x, 0.2 * z - y, -y) is None
    assert midpoint(-x, x, y, x) is None
    almost = np.array([1.0, -1e-6, 0.0])  # they meet 1000 km away
    assert midpoint(-x, x, y - x, almost / np.linalg.norm(almost)) is None


def test_midpoint_of_oblique_rays_is_the_middle_of_the_closest_points(rng):
    """Least squares over both lengths, for rays at any angle that pass each other before both centres."""
    for _ in range(20):
        meeting = rng.normal(size=3)
        centers = rng.normal(size=(2, 3))
        rays = meeting + 0.01 * rng.normal(size=(2, 3)) - centers
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        lengths = np.linalg.lstsq(np.column_stack([rays[0], -rays[1]]), centers[1] - centers[0])[0]
        expected = (centers + lengths[:, None] * rays).mean(axis=0)
        np.testing.assert_allclose(midpoint(centers[0], rays[0], centers[1], rays[1]), expected, atol=1e-9)


@pytest.mark.parametrize("eye", [0, 1])
@pytest.mark.parametrize(
    "cov",
    [
        np.zeros((2, 2)),
        np.ones((2, 2)),
        np.diag([1.0, 0.0]),
        [[1.0, 2.0], [2.0, 1.0]],
        -ONE_PX,
        ONE_PX * np.nan,
        np.diag([np.inf, 1.0]),
        np.diag([1.0, np.inf]),
    ],
    ids=["zero", "rank one", "singular", "indefinite", "negative", "nan", "infinite", "infinite downwards"],
)
def test_a_covariance_that_is_none_is_refused(view, eye, cov):
    p = (view.left.T_root_camera @ [0.02, 0.01, 0.4, 1])[:3]
    covs = [ONE_PX, ONE_PX]
    covs[eye] = np.asarray(cov)
    with pytest.raises(ValueError, match="expected a positive definite one"):
        triangulate(view, view.left.project(p), view.right.project(p), *covs)

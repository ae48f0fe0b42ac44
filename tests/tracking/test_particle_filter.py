"""Particle filter over whole objects, on silhouettes drawn by OpenCV's camera model, and on Gaussian densities."""

from itertools import pairwise

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import Camera, View
from pps_vision.geometry.se3 import inverse, transform
from pps_vision.types import Array, Mask
from tracking import particle_filter as pf

CAMERA = Camera(640, 480, 520.0, 510.0, 314.0, 244.0, (-0.2, 0.05, 0.001, -0.002, 0.0))
K = np.array([[520.0, 0, 314], [0, 510, 244], [0, 0, 1]])
TURNS = np.array([[0.02, 0.1, 0.01], [0.0, -0.1, 0.02]])  # rotation vectors of the root frame in both eyes
SHIFTS = np.array([[0.034, 0, 0], [-0.034, 0, 0]])
RADIUS_M = 0.035
P = np.array([0.01, 0.02, 0.4])
STD_M = 0.004
V, U = np.mgrid[:480, :640]
HALVES = "left", "upper"  # hidden in the left and in the right eye


def pixels(points: Array, eye: int) -> Array:
    """(n, 2) px of points (n, 3) in an eye, by OpenCV."""
    return cv2.projectPoints(points.reshape(-1, 1, 3), TURNS[eye], SHIFTS[eye], K, np.array(CAMERA.distortion))[0][:, 0]


def view(eye: int) -> View:
    return View(CAMERA, inverse(transform(cv2.Rodrigues(TURNS[eye])[0], SHIFTS[eye])))


def ball_rim(p: Array, eye: int) -> Array:
    """Points (n, 3) where the rays from an eye touch a ball."""
    ahead = p + cv2.Rodrigues(TURNS[eye])[0].T @ SHIFTS[eye]  # from the eye
    share = RADIUS_M**2 / (ahead @ ahead)
    axes = np.linalg.svd(ahead[None])[2]
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)[:, None]
    circle = np.cos(angle) * axes[1] + np.sin(angle) * axes[2]
    return p - share * ahead + RADIUS_M * np.sqrt(1 - share) * circle


def plate_rim(p: Array, corners: tuple[tuple[float, float], ...]) -> Array:
    """Points (n, 3) along the edge of a plate with these corners (k, 2) in units of the radius, across the root's z."""
    edge = np.concatenate([np.linspace(a, b, 50) for a, b in pairwise([*corners, corners[0]])])
    return p + RADIUS_M * np.column_stack([edge, np.zeros(len(edge))])


def filled(rim: Array, eye: int) -> Mask:
    mask = np.zeros(U.shape, np.uint8)
    cv2.fillPoly(mask, [np.rint(16 * pixels(rim, eye)).astype(np.int32)], 1, shift=4)
    return mask > 0


def drawn(
    p: Array, rims: list[Array], hidden: tuple[str, str], templates: list[pf.Template] | None = None
) -> list[pf.Eye]:
    """Both eyes' input for an object within rims (n, 3), half hidden by something of another colour."""
    eyes = []
    for k, rim in enumerate(rims):
        evidence = np.where(filled(rim, k), 1.0, -1.0).astype(np.float32)
        u, v = pixels(p, k)[0]
        evidence[{"left": u > U, "upper": v > V, "": np.zeros(U.shape, bool)}[hidden[k]]] = -0.3
        template = templates[k] if templates else pf.disc()
        eyes.append(pf.Eye(view(k), (0.0, 0.0), template, pf.Evidence(cv2.blur(evidence, (3, 3)), (0, 0), (640, 480))))
    return eyes


def ball(p: Array, hidden: tuple[str, str] = ("", "")) -> list[pf.Eye]:
    return drawn(p, [ball_rim(p, k) for k in (0, 1)], hidden)


def predictions(p: Array) -> list[pf.Prediction]:
    """Off by draws of their covariance."""
    off = STD_M * np.random.default_rng(0).standard_normal((20, 3))
    return [pf.Prediction(p + d, STD_M**2 * np.eye(3), RADIUS_M) for d in off]


def located(predicted: list[pf.Prediction], eyes: list[pf.Eye], count: int = 120) -> list[pf.Located]:
    params = pf.ParticleFilterParams(count=count)
    return [pf.locate(params, p, eyes, np.random.default_rng(seed)) for seed, p in enumerate(predicted)]


def is_at(results: list[pf.Located], p: Array) -> bool:
    """Whether most positions are within a few mm of `p` (3,), and it in their 99.9 % ellipsoid."""
    off = np.array([result.p_root - p for result in results])
    chi2 = np.array([d @ np.linalg.solve(result.cov_root, d) for d, result in zip(off, results, strict=True)])
    off_mm = 1e3 * np.linalg.norm(off, axis=1)
    return bool(np.median(off_mm) < 3 and np.quantile(off_mm, 0.9) < 6 and np.mean(chi2 < 16.3) >= 0.8)


HIGH = np.array([0.01, -0.18, 0.4])  # where the upper border of both images cuts a ball


@pytest.mark.parametrize(
    ("p", "hidden", "count", "is_located"), [(P, HALVES, 120, True), (P, HALVES, 2, False), (HIGH, ("", ""), 120, True)]
)
def test_a_ball_half_hidden_or_cut_by_the_border_is_located_by_many(p, hidden, count, is_located):
    assert is_at(located(predictions(p), ball(p, hidden), count), p) == is_located


SQUARE = (-1, -1), (1, -1), (1, 1), (-1, 1)
ELL = (-1, -1.2), (-0.2, -1.2), (-0.2, 0.4), (1, 0.4), (1, 1.2), (-1, 1.2)


@pytest.mark.parametrize("corners", [SQUARE, ELL], ids=["square", "L"])
def test_a_plate_half_hidden_is_located_by_its_earlier_silhouette_and_not_by_a_balls(corners):
    """Elsewhere, and farther away."""
    early = np.array([-0.03, 0.0, 0.45])
    masks = [filled(plate_rim(early, corners), k) for k in (0, 1)]
    places = [((0, 0, 640, 480), view(k), early, pixels(early, k)[0], RADIUS_M) for k in (0, 1)]
    templates = [pf.template_of(pf.Silhouette(mask, *place)) for mask, place in zip(masks, places, strict=True)]
    rims = [plate_rim(P, corners)] * 2
    assert is_at(located(predictions(P), drawn(P, rims, HALVES, templates)), P)
    assert not is_at(located(predictions(P), drawn(P, rims, HALVES)), P)


def test_what_images_tell_and_the_prediction_give_what_was_located():
    """As Gaussian densities, where the images tell something; where they show nothing, they tell nothing."""
    compared = 0
    for p, result in zip(predictions(P), located(predictions(P), ball(P, HALVES)), strict=True):
        information = np.linalg.inv(result.measured_cov)
        if np.linalg.eigvalsh(result.cov_root)[-1] < 0.6 * STD_M**2:
            cov = np.linalg.inv(np.eye(3) / STD_M**2 + information)
            np.testing.assert_allclose(cov, result.cov_root, atol=1e-9)
            mean = cov @ (p.p_root / STD_M**2 + information @ result.measured)
            np.testing.assert_allclose(mean, result.p_root, atol=1e-6)
            compared += 1
    assert compared > 10
    nothing = pf.Evidence(np.zeros(U.shape, np.float32), (0, 0), (640, 480))
    unseen = [eye._replace(evidence=nothing) for eye in ball(P)]
    for p, result in zip(predictions(P), located(predictions(P), unseen), strict=True):
        assert np.linalg.eigvalsh(result.measured_cov)[0] > STD_M**2
        assert np.linalg.norm(result.measured - p.p_root) < 7 * STD_M  # no particle is farther


@pytest.mark.parametrize("precision", [0.3, 2.0, 30.0])
def test_the_posterior_of_gaussian_densities_is_their_product(precision):
    """A quadratic score that tells nothing of the last dimension; the mean over seeds."""
    A = precision * np.array([[1.0, 0.5, 0], [0.5, 1.0, 0], [0, 0, 0]])
    best = np.array([1.0, -0.5, 0])
    params = pf.ParticleFilterParams()

    def score(x: Array) -> Array:
        return -0.5 * np.einsum("ni,ij,nj->n", x - best, A, x - best) / params.sharpness

    results = [pf.posterior(params, 3, score, np.random.default_rng(seed)) for seed in range(200)]
    cov = np.linalg.inv(np.eye(3) + A)
    np.testing.assert_allclose(np.mean([mean for mean, _ in results], axis=0), cov @ A @ best, atol=0.05)
    np.testing.assert_allclose(np.mean([cov for _, cov in results], axis=0), cov, rtol=0.15, atol=0.02)

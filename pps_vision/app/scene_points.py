"""Points of the scene that both images show, or images of two moments, against the cameras: a wrong calibration, wrong
images and wrong joints, in words."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np

from pps_vision.geometry.camera import Camera, StereoRig, StereoView, View
from pps_vision.geometry.se3 import inverse, transform
from pps_vision.types import Array, Image, Mask, StereoFrame

_FEATURES = 800  # per image, of this contrast and more: soft walls show little
_CONTRAST = 0.01
_HALF = 0.5
_DISTINCT = 0.8  # Lowe's ratio: distance of the best match relative to the second best
_SAME_SCENE_PX = 3.0  # from an epipolar line of the fundamental matrix that most matches fit
_FEWEST = 15  # such matches that tell anything
_MOST = 0.7  # share of matches: fewer fit a fundamental matrix by chance; of sound ones at least 0.9
_FITS_PX = 0.5  # median misfit of a calibration in images of up to 1280 columns
_DOUBTFUL_PX = 0.3  # from which a turn that fits clearly better is told
_SOUND_PX = 0.15  # the same of sound ones: up to 0.12 (seeds 400–407)
_BETTER = 0.7  # misfit with the cameras turned relative to before: 0.9–1.2 of sound ones (the same seeds)
_STRETCH = 0.03  # change of the distances by it that matters
_COLUMNS = 1280
_FLATTEST = 0.1  # cosine of the angle from the axis to which the rays of a fisheye reach in a plane
_BEHIND_PX = -1.0  # parallax of a point behind the cameras; that of a far point is 0
_CLEARLY = 0.4  # misfit after a remedy relative to before
_MANY_MORE = 2  # times as many matches of an image that is mirrored back
_AS_GOOD = 1.3  # misfit after a remedy relative to that after the best
_TURNED_DEG = 2.0  # by which joints and images may differ: nearby points shift as the head moves
_TURNED_SHARE = 0.5  # relative to the turn
_STILL_DEG = 0.1
_STEPS = 30  # steps of the fit of a turn
_STEP_RAD = 1e-6  # of its derivatives, and by which the last step is smaller
_ALIKE = np.pi / 4  # angle between the optical axes up to which images show the same: SIFT matches up to about 40°
_LEFT = "to the LEFT of"
_SHARP_PX = 8.0  # largest diameter of a feature whose error does not grow with it
Matched = tuple[Array, Array, Array]
"""Pixels (n, 2) of the same points in two images, and the features' diameters (n,), px."""
Matcher = Callable[[StereoFrame], Matched]


@dataclass(frozen=True)
class Matches:
    """Pixels (n, 2) of the same points in the left and the right image of a frame, and the features' diameters (n,)."""

    view: StereoView
    left_px: Array
    right_px: Array
    sizes_px: Array

    @property
    def error(self) -> Array:
        """(n,) error of the pixels, relative to that of small features."""
        return np.maximum(self.sizes_px / _SHARP_PX, 1.0)


@dataclass(frozen=True)
class Fit:
    """How matches fit the cameras."""

    n: int
    median_px: float  # median distance from the epipolar line
    misfit_px: float  # the same relative to the features' errors
    behind: float  # share of the points behind the cameras

    @property
    def cost_px(self) -> float:
        """The misfit; infinite where most points lie behind the cameras."""
        return np.inf if self.behind > _HALF else self.misfit_px

    def __str__(self) -> str:
        return "most matches lie behind the cameras" if self.behind > _HALF else f"within {self.median_px:.2g} px"


def faults_by_points(
    frames: Sequence[StereoFrame], rig: StereoRig, by_joints: bool = False, matcher: Matcher | None = None
) -> Iterator[str]:
    """A calibration or images that points which both images show do not fit; `by_joints`: the cameras' pose is not the
    calibration's; `matcher` returns a frame's points, if they were matched already."""
    view = rig.view_of(frames[0])
    side = side_of(view)
    baseline = length(float(np.linalg.norm(view.right.center - view.left.center)))
    lies = f"the right camera lies {baseline} {side} the left one"
    finer = max(1.0, rig.left.width / _COLUMNS)
    fits_px = _FITS_PX * finer
    kept = matches(frames, rig, matcher)
    if kept:
        as_is, turn = fit(kept), _best_turn(kept)
        if as_is.cost_px <= fits_px and (by_joints or not turn.matters(as_is, finer)):
            return
    elif view.axes_angle_rad > _ALIKE:  # the images have nothing in common
        return
    found = {
        name: matches([replace(frame, **{name: np.fliplr(getattr(frame, name)).copy()}) for frame in frames], rig)
        for name in ("left", "right")
    }
    more = _MANY_MORE * sum(len(m.left_px) for m in kept)
    costs_px = {name: fit(both).cost_px for name, both in found.items() if sum(len(m.left_px) for m in both) > more}
    name = min(costs_px, key=costs_px.__getitem__, default="")
    if name and costs_px[name] <= _SAME_SCENE_PX:
        n = sum(len(m.left_px) for m in found[name])
        yield f"the {name} image not mirrored: {n} points match and fit the cameras once it is mirrored back"
        return
    if not kept:
        if side == _LEFT:
            yield f"--left and --right exchanged, or another calibration: by it {lies}"
        return
    possible = _OF_IMAGES if by_joints else _OF_IMAGES | _OF_POSE
    remedies = {name: fit([remedy(m) for m in kept]) for name, remedy in possible.items()}
    best = min(remedies.values(), key=lambda remedied: remedied.cost_px)
    shown = f"{as_is.n} points that both images show"
    turned = str(turn) if turn.misfit_px <= fits_px else ""
    if best.cost_px <= min(fits_px, _CLEARLY * as_is.cost_px):
        as_good = [name for name, remedied in remedies.items() if remedied.cost_px <= _AS_GOOD * best.cost_px + 0.1]
        names = ", or ".join(as_good[:3])
        message = f"{names}: {shown} then fit the cameras within {best.median_px:.1f} px (median), as they are {as_is}"
    elif as_is.cost_px == np.inf:
        message = f"another calibration, or --left and --right exchanged: of {shown} {as_is}{turned}"
    else:
        message = f"another calibration: {shown} fit the cameras only {as_is} (median){turned}"
    yield message + (f"; by the calibration {lies}" if side == _LEFT else "")


def length(metres: float) -> str:
    """A length in words, in m or mm, without an exponent."""
    value, unit = (metres, "m") if metres >= 1 else (1000 * metres, "mm")
    return f"{np.format_float_positional(value, 4, fractional=False, trim='-')} {unit}"


def side_of(view: StereoView) -> str:
    """Where the right camera lies from the left one, in the left one's image: "to the right of" it, and so on."""
    x, y, z = view.left.T_camera_root[:3, :3] @ (view.right.center - view.left.center)
    sides = {"to the right of": x, _LEFT: -x, "below": y, "above": -y, "ahead of": z, "behind": -z}
    return max(sides, key=sides.__getitem__)


def matches(frames: Sequence[StereoFrame], rig: StereoRig, matcher: Matcher | None = None) -> list[Matches]:
    """Matched points that fit one fundamental matrix: of fixed cameras of all frames together, else of each; none where
    few do."""
    of_frame = matcher or (lambda frame: match(frame.left, frame.right))
    found = [Matches(rig.view_of(frame), *of_frame(frame)) for frame in frames]
    if frames[0].joints_left_rad is None:
        parts = (np.concatenate([getattr(m, f"{name}_px") for m in found]) for name in ("left", "right", "sizes"))
        found = [Matches(found[0].view, *parts)]
    kept = []
    for m in found:
        if len(m.left_px) < _FEWEST:
            continue
        same = _of_one_scene(_plane(m.view.left, m.left_px), _plane(m.view.right, m.right_px))
        if same.sum() >= _FEWEST:
            kept.append(Matches(m.view, m.left_px[same], m.right_px[same], m.sizes_px[same]))
    return kept


def match(left: Image, right: Image) -> Matched:
    """SIFT features in two images that are each other's best match."""
    # else features lie a quarter of a pixel to the lower right, and twice that off between images rolled by 180°
    sift = cv2.SIFT.create(nfeatures=_FEATURES, contrastThreshold=_CONTRAST, enable_precise_upscale=True)
    points, features = zip(
        *(sift.detectAndCompute(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), None) for image in (left, right)), strict=True
    )
    if min(0 if found is None else len(found) for found in features) < 2:
        return np.empty((0, 2)), np.empty((0, 2)), np.empty(0)
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    back = {(m.trainIdx, m.queryIdx) for m in matcher.match(features[1], features[0])}
    forth = matcher.knnMatch(features[0], features[1], k=2)
    pairs = [(a.queryIdx, a.trainIdx) for a, b in forth if a.distance < _DISTINCT * b.distance]
    mutual = [pair for pair in pairs if pair in back]
    left_px, right_px = (np.reshape([points[side][pair[side]].pt for pair in mutual], (-1, 2)) for side in (0, 1))
    return left_px, right_px, np.array([points[0][i].size for i, _ in mutual])


def fit(found: Sequence[Matches]) -> Fit:
    """How matches fit the cameras."""
    aside, parallax = np.hstack([_epipolar(m.view.left, m.view.right, m.left_px, m.right_px) for m in found])
    error = np.concatenate([m.error for m in found])
    return Fit(len(aside), *_medians_px(aside, error), float(np.mean(parallax / error < _BEHIND_PX)))


def _medians_px(aside: Array, error: Array) -> tuple[float, float]:
    """Median size of epipolar distances (n,), and of these relative to the features' errors (n,)."""
    return float(np.median(np.abs(aside))), float(np.median(np.abs(aside / error)))


def _epipolar(left: View, right: View, left_px: Array, right_px: Array) -> Array:
    """(2, n) px: signed epipolar distances of matched pixels (n, 2), and parallaxes (positive in front)."""
    left_rays = left.rays(left_px)
    right_rays = right.rays(right_px)
    baseline = right.center - left.center
    along = baseline / np.linalg.norm(baseline)
    normal = np.cross(along, left_rays)
    aside = np.sum(normal * right_rays, axis=1) / np.linalg.norm(normal, axis=1)
    parallax = np.arccos(np.clip(right_rays @ along, -1, 1)) - np.arccos(np.clip(left_rays @ along, -1, 1))
    return left.camera.focal_px * np.array([np.arcsin(np.clip(aside, -1, 1)), parallax])


def _plane(view: View, px: Array) -> Array:
    """(n, 2) px from the principal point, where a camera without a lens would see them."""
    rays = view.camera.bearings(px)
    return np.asarray(view.camera.focal_px * rays[:, :2] / np.maximum(rays[:, 2:], _FLATTEST))


def _of_one_scene(left: Array, right: Array) -> Mask:
    """(n,) whether a match fits the fundamental matrix of most; of none where fewer than most do."""
    nowhere = np.zeros(len(left), bool)
    try:
        _, mask = cv2.findFundamentalMat(left, right, cv2.USAC_MAGSAC, _SAME_SCENE_PX, 0.999, 2000)
    except cv2.error:  # of matches that determine none
        return nowhere
    return nowhere if mask is None or np.mean(mask) < _MOST else np.asarray(mask).ravel() > 0


@dataclass(frozen=True)
class _Turn:
    """The rotation to be added between the cameras for matches to fit best."""

    degrees: float
    median_px: float
    misfit_px: float  # relative to the features' errors, as in `Fit`
    stretch: float  # median distance of the points after it relative to before

    def __str__(self) -> str:
        return f"; with the cameras turned by another {self.degrees:.1f}° to each other, within {self.median_px:.2g} px"

    def matters(self, as_is: Fit, finer: float) -> bool:
        """Whether the matches fit clearly better with it; a little better where distances are then others."""
        if as_is.misfit_px > _DOUBTFUL_PX * finer and self.misfit_px < _CLEARLY * as_is.misfit_px:
            return True
        is_better = as_is.misfit_px > _SOUND_PX * finer and self.misfit_px < _BETTER * as_is.misfit_px
        return is_better and as_is.n > 3 * _FEWEST and abs(self.stretch - 1) > _STRETCH


def _best_turn(kept: Sequence[Matches]) -> _Turn:
    m = max(kept, key=lambda found: len(found.left_px))

    def turned(rotation: Array) -> Array:
        T_root_left = m.view.left.T_root_camera @ transform(np.asarray(cv2.Rodrigues(rotation)[0]))
        return _epipolar(View(m.view.left.camera, T_root_left), m.view.right, m.left_px, m.right_px) / m.error

    rotation = np.zeros(3)
    for _ in range(_STEPS):  # least squares with the weights of the loss soft_l1 (2 (√(1 + e²) − 1))
        aside, _ = turned(rotation)
        slopes = np.array([turned(rotation + axis)[0] - aside for axis in _STEP_RAD * np.eye(3)]) / _STEP_RAD
        weighted = slopes / np.sqrt(1 + (aside / _DOUBTFUL_PX) ** 2)
        step = np.linalg.lstsq(weighted @ slopes.T, -weighted @ aside)[0]
        rotation = rotation + step
        if np.abs(step).max() < _STEP_RAD:
            break
    aside, parallax = turned(rotation)
    stretch = float(np.median(turned(np.zeros(3))[1]) / (np.median(parallax) or np.inf))
    return _Turn(float(np.rad2deg(np.linalg.norm(rotation))), *_medians_px(m.error * aside, m.error), stretch)


def _angle_deg(R: Array) -> float:
    return float(np.rad2deg(np.arccos(np.clip((np.trace(R) - 1) / 2, -1, 1))))


def _posed(change: Callable[[Array, Array], tuple[Array, Array]]) -> Callable[[Matches], Matches]:
    """Another R and t of p_right = R p_left + t."""

    def remedy(m: Matches) -> Matches:
        T_right_left = m.view.right.T_camera_root @ m.view.left.T_root_camera
        R, t = change(T_right_left[:3, :3], T_right_left[:3, 3])
        T_root_right = m.view.left.T_root_camera @ inverse(transform(R, t))
        return replace(m, view=StereoView(m.view.left, View(m.view.right.camera, T_root_right)))

    return remedy


def _lenses(change: Callable[[Camera, Camera], tuple[Camera, Camera]]) -> Callable[[Matches], Matches]:
    """Other cameras at the same poses."""

    def remedy(m: Matches) -> Matches:
        left, right = change(m.view.left.camera, m.view.right.camera)
        return replace(m, view=StereoView(replace(m.view.left, camera=left), replace(m.view.right, camera=right)))

    return remedy


def _other_lens(camera: Camera) -> Camera:
    turned = replace(camera, distortion=tuple(-k for k in camera.distortion))
    return turned if turned.is_usable() else camera


def _flipped(left: bool, right: bool, rows: bool) -> Callable[[Matches], Matches]:
    """Images that are mirrored, or with `rows` upside down."""

    def px(camera: Camera, pixels: Array) -> Array:
        far = np.array([camera.width - 1, camera.height - 1 if rows else 0])
        return far + pixels * (-1, -1 if rows else 1)

    def remedy(m: Matches) -> Matches:
        left_px = px(m.view.left.camera, m.left_px) if left else m.left_px
        return replace(m, left_px=left_px, right_px=px(m.view.right.camera, m.right_px) if right else m.right_px)

    return remedy


_GL = np.diag([1.0, -1.0, -1.0])  # from OpenGL's axes to OpenCV's
_Remedies = dict[str, Callable[[Matches], Matches]]
_OF_IMAGES: _Remedies = {
    "--left and --right exchanged, or the folders cam/left and cam/right": lambda m: replace(
        m, left_px=m.right_px, right_px=m.left_px
    ),
    "the cameras of the calibration exchanged": _lenses(lambda left, right: (right, left)),
    "the distortion of the calibration with the other sign": _lenses(lambda a, b: (_other_lens(a), _other_lens(b))),
    "both images not mirrored": _flipped(True, True, rows=False),
    "the right image not mirrored": _flipped(False, True, rows=False),
    "the left image not mirrored": _flipped(True, False, rows=False),
    "both images turned by 180°": _flipped(True, True, rows=True),
    "the right image turned by 180°": _flipped(False, True, rows=True),
    "the left image turned by 180°": _flipped(True, False, rows=True),
}
_OF_POSE: _Remedies = {
    "R of the calibration transposed, as MATLAB needs it": _posed(lambda R, t: (R.T, t)),
    "R and T of the calibration inverted: they seem to lead from right to left": _posed(lambda R, t: (R.T, -R.T @ t)),
    "T of the calibration with the other sign": _posed(lambda R, t: (R, -t)),
    "T of the calibration as -R T: it seems to be the right camera's place": _posed(lambda R, t: (R, -R @ t)),
    "R and T of the calibration with OpenCV's axes, not OpenGL's": _posed(lambda R, t: (_GL @ R @ _GL, _GL @ t)),
}
"""What to try: matches as they would be after it."""


def faults_of_joints(frames: Sequence[StereoFrame], rig: StereoRig) -> Iterator[str]:
    """Joints by which the left camera turns otherwise than its images do."""
    for first, second in pairwise(frames):
        views = [rig.view_of(frame).left for frame in (first, second)]
        joints_R = views[1].T_camera_root[:3, :3] @ views[0].T_root_camera[:3, :3]
        R = _turn_by_images(views[0], first.left, second.left)
        if R is None:
            continue
        images_deg, joints_deg = _angle_deg(R), _angle_deg(joints_R)
        if _angle_deg(R @ joints_R.T) <= max(_TURNED_DEG, _TURNED_SHARE * max(images_deg, joints_deg)):
            continue
        reason = "as if it were in radians" if 40 < images_deg / max(joints_deg, 1e-9) < 80 else "other than the images"
        if joints_deg < _STILL_DEG:
            reason = "as if it stood still"
        yield (
            f"another log of the head, or one in degrees: from {first.stamp_left_s:.2f} s to {second.stamp_left_s:.2f} "
            f"s the left camera turns by {images_deg:.1f}° by its images, by {joints_deg:.1f}° by the joints, {reason}"
        )
        return


def _turn_by_images(view: View, first: Image, second: Image) -> Array | None:
    """R (3, 3) that turns the rays of one image into the rays of a later one (Kabsch 1976), None where few match."""
    before_px, after_px, _ = match(first, second)
    if len(before_px) < _FEWEST:
        return None
    _, mask = cv2.findHomography(before_px, after_px, cv2.USAC_MAGSAC, _SAME_SCENE_PX)
    if mask is None or mask.sum() < _FEWEST or mask.mean() < _HALF:
        return None
    same = np.asarray(mask).ravel() > 0
    U, _, Vt = np.linalg.svd(view.camera.bearings(after_px[same]).T @ view.camera.bearings(before_px[same]))
    return np.asarray(U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt)

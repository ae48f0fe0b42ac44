"""While something is tracked: where one eye should see it now, and where it does."""

import math

import numpy as np
from numba import njit

from pps_vision.geometry.compiled import Vector
from pps_vision.types import Array, CameraName, Detection2D
from tracking.background import Background
from tracking.ego_motion import EgoMotion
from tracking.eye import EyeParams, EyeTracker, Sighting
from tracking.kalman import Belief
from tracking.look import Look, Looks
from tracking.marker import Found, MarkerParams, find_markers
from tracking.outline import Optics, Outline
from tracking.particles import Prior

_SAME_SIZE = 0.03  # from one frame to the next, what is wholly seen twice differs by less
_MAX_GROWTH = 1.25  # of the image of what approaches, from one frame to the next
_SIZE_RATE = 0.1  # at which a size that does differ is believed


class Follower:
    """One eye's memory of the object: its image tracker, its size, and how far the calibration puts the
    track from it; for grey images the scene without it."""

    def __init__(
        self,
        name: CameraName,
        optics: Optics,
        params: EyeParams,
        marker: MarkerParams | None,
        background_memory_s: float,
        rng: np.random.Generator,
    ) -> None:
        self.name, self.optics, self.marker = name, optics, marker
        self.object = EyeTracker(params, optics, rng)
        self.background = Background(EgoMotion(optics.camera), background_memory_s)
        self._offset_px = (0.0, 0.0)  # of the outline from the track's projection: calibration error
        self._size_px = 0.0

    def find(self, look: Look, prior: Prior | None, grey: bool) -> Sighting | None:
        """The object near where it should be."""
        if prior is None:
            return None
        if self.marker is not None:
            return self._nearest_marker(self.marker, look, prior)
        evidence = self.background.evidence(look.image, look.view) if grey else None
        return self.object.step(look.image, prior, evidence)

    def remember(self, look: Look, shape: Outline, belief: Belief) -> None:
        """Where the object is relative to the track, and how large."""
        (u, v), (x, y) = look.view.pixel(*_place(belief, look.stamp_s)), shape.center_px.tolist()
        self._offset_px = x - u, y - v
        size_px = self._size_of(shape)
        if self.marker is not None and self._size_px and shape.oddness >= 0.5:  # partly hidden, or it was
            size_px = self._size_px * (size_px / self._size_px) ** _SIZE_RATE
        self._size_px = size_px

    def _size_of(self, shape: Outline) -> float:
        return 2 * shape.angular_radius_rad * self.optics.camera.focal_px

    def forget(self) -> None:
        """Follow nothing any more."""
        self.object.forget()
        self._size_px = 0.0

    def detection(self, look: Look, seen: Sighting) -> Detection2D:
        """What was seen, with eye and stamp."""
        shape = seen.outline
        return Detection2D(
            look.stamp_s, self.name, shape.center_px, shape.cov_px, seen.score, shape.angular_radius_rad, seen.box_px
        )

    def prior(self, look: Look, last: Belief, now: Belief) -> Prior | None:
        """Where the track says this eye sees the object; None where it cannot."""
        x, y, z = _place(now, look.stamp_s)
        u, v, of_u, of_v = look.view.project_linearised(x, y, z)
        center = u + self._offset_px[0], v + self._offset_px[1]
        if not self.optics.camera.contains(center, margin_px=-0.5 * self._size_px):
            return None
        std = _std_px(now.cov, of_u, of_v)
        eye = look.view.place
        growth = math.dist(last.mean[0].tolist(), eye) / math.dist((x, y, z), eye)
        return Prior(np.array(center), min(max(std, 0.7), 40.0), min(max(growth, 1 / _MAX_GROWTH), _MAX_GROWTH))

    def clear_object(self, prior: Prior | None, found: Found) -> Sighting | None:
        """What was `found` already, as large as it should be; None where something may hide it."""
        if prior is None or found is None:
            return None
        half = 0.5 * self._size_px + 2 * prior.std_px + 4
        near = (one for one in found if float(np.abs(one.center_px - prior.center_px).max()) < half)
        return self._whole_object(next(near, None), prior)

    def _whole_object(self, shape: Outline | None, prior: Prior) -> Sighting | None:
        """An object that is as large as it should be."""
        expected_px = prior.growth * self._size_px
        if shape is None or abs(self._size_of(shape) / expected_px - 1) >= _SAME_SIZE or shape.oddness >= 0.5:
            return None
        return Sighting(shape, shape.box_px, 1.0)

    def _nearest_marker(self, params: MarkerParams, look: Look, prior: Prior) -> Sighting | None:
        """The nearest blob in reach of where the marker should be that is no larger than the marker: a larger one has
        grown together with something else of its hue."""
        near = *prior.center_px.tolist(), self._size_px + 4 * prior.std_px + 3
        blobs = find_markers(params, look.image, self.optics, near)
        shape = _nearest([one for one in blobs if self._size_of(one) < _MAX_GROWTH * self._size_px], prior)
        if (whole_seen := self._whole_object(shape, prior)) is not None:
            return whole_seen
        self._size_px *= prior.growth
        return None if shape is None else Sighting(shape, shape.box_px, 1.0)


def _place(belief: Belief, stamp_s: float) -> Vector:
    """Where the object is when an eye's image is taken, which may not be when the pair's is."""
    (x, y, z), *rates = belief.mean.tolist()
    if not rates:
        return x, y, z
    dt, (vx, vy, vz) = stamp_s - belief.stamp_s, rates[0]
    return x + vx * dt, y + vy * dt, z + vz * dt


@njit(cache=True, error_model="numpy")
def _std_px(cov: Array, of_u: Vector, of_v: Vector) -> float:
    """Of the image of a point whose covariance is the first three rows and columns; ∂u and ∂v by it."""
    var = 0.0
    for i in range(3):
        for j in range(3):
            var += cov[i, j] * (of_u[i] * of_u[j] + of_v[i] * of_v[j])
    return math.sqrt(var)


def _nearest(found: list[Outline], prior: Prior) -> Outline | None:
    """To where it is expected."""
    at = prior.center_px.tolist()
    return min(found, key=lambda one: math.dist(one.center_px.tolist(), at), default=None)


def find_both(
    eyes: tuple[Follower, Follower],
    looks: Looks,
    last: Belief,
    now: Belief,
    grey: bool,
    odd: bool,
    found: tuple[Found, Found],
) -> tuple[Sighting | None, Sighting | None]:
    """The object in both eyes, near where the track, whose belief was `last` and is `now`, puts it; `odd`: it is no
    ball; `found`: what was found of it in both images already."""
    (left, right), (in_left, in_right) = eyes, looks
    a, b = left.prior(in_left, last, now), right.prior(in_right, last, now)
    both = left.clear_object(a, found[0]), right.clear_object(b, found[1])
    if both[0] is not None and both[1] is not None:
        left.object.carry(both[0].outline)
        right.object.carry(both[1].outline)
        return both
    return alike(left.find(in_left, a, grey), right.find(in_right, b, grey), odd)


def alike(left: Sighting | None, right: Sighting | None, odd: bool) -> tuple[Sighting | None, Sighting | None]:
    """Both as they show where one eye only completes what is no sphere: the middle of what shows and that of the
    whole are two things, and no point of the object is in between.  What has been `odd` all along is no ball now,
    though some cone may fit what shows."""
    if odd:
        left, right = (as_shown(one) if one and one.outline.oddness == 0 else one for one in (left, right))
    if left is None or right is None:
        return left, right
    one, other = left.outline, right.outline
    if one.shown is not None and one.oddness > 0 and other.shown is None and other.oddness > 0:
        return as_shown(left), right
    if other.shown is not None and other.oddness > 0 and one.shown is None and one.oddness > 0:
        return left, as_shown(right)
    return left, right


def as_shown(seen: Sighting) -> Sighting:
    """Nothing of it completed."""
    return seen if seen.outline.shown is None else seen._replace(outline=seen.outline.shown)

"""What is filmed for the failure map: one ball by itself, and everything that needs a scene of its own."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np
import trimesh

from control.fixation import gaze_at
from pps_vision.experiments import disturbances
from pps_vision.experiments.footage import EYES_M, Footage, Studio
from pps_vision.robot.icub import home
from pps_vision.robot.skin import icub_skin
from pps_vision.types import Array
from rendering.motions import Circle, Motion
from rendering.scene import Placed
from rendering.shapes import Part, board, sphere
from rendering.stimuli import BLUE, RED, Stimulus, make_stimulus

FINE = 5  # fine footage has this many frames for one of the usual 20 a second
NOISE = 2.0  # grey levels of 255, in all that is filmed
RADIUS_M, PASSING_M_S = 0.035, 0.12
HIDDEN_S = (0.1, 0.25, 0.5, 1.0, 2.0)
_FAR_M, _BOARD_M = 0.42, 0.36  # before the eyes: the ball, a board before it
_ASIDE = np.array([0.0, 1.0, 0.0])
_FACING = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # a board's normal towards the robot


def _board_width(hidden_s: float) -> float:
    """What hides a passing ball from both eyes at once for so long."""
    return (PASSING_M_S * hidden_s + 2 * RADIUS_M + 0.010) * _BOARD_M / _FAR_M


def stage_props() -> dict[str, tuple[Part, ...]]:
    """What a `Studio` needs for these scenes."""
    boards = {f"board {s}": (board(_board_width(s), 0.3),) for s in HIDDEN_S}
    return {**boards, "twin": (sphere(RADIUS_M, RED),), "other": (sphere(RADIUS_M, BLUE),)}


class Scenes:
    """One set of films; the seed places the ball and drives whatever is random."""

    def __init__(self, studio: Studio, seed: int) -> None:
        self.studio, self.seed = studio, seed
        rng = np.random.default_rng((seed, 0))
        self._center = EYES_M + np.array([-_FAR_M, *(rng.uniform(-0.04, 0.04, 2) - [0.0, 0.06])])
        self._phase = rng.uniform(0, 2 * np.pi)

    def rng(self) -> np.random.Generator:
        """The same for every disturbance."""
        return np.random.default_rng((self.seed, 1))

    def sensed(self, footage: Footage) -> Footage:
        """With the usual sensor noise."""
        return disturbances.noisy(footage, NOISE, self.rng())

    def _circle(self, speed_m_s: float = 0.15, scale: float = 1.0, center: Array | None = None) -> Motion:
        """Around in a plane that is oblique to the eyes; `scale` 1 is 6 cm."""
        c, s = np.cos(self._phase), np.sin(self._phase)
        axes = np.array([[0.5 * c, 0.85, 0.5 * s], [-0.6 * s, 0.1, 0.8 * c]])
        first = axes[0] / np.linalg.norm(axes[0])
        second = axes[1] - (axes[1] @ first) * first
        middle = self._center if center is None else center
        return Circle(middle, np.array([first, second / np.linalg.norm(second)]), 0.06 * scale, speed_m_s)

    @cached_property
    def fine(self) -> Footage:
        """A ball at 15 cm/s, eyes that follow, a head that sways: 2.5 s at 100 frames a second, noiseless."""
        return self.studio.film(self._circle(), 2.5, self.studio.follow, fps=20 * FINE)

    @cached_property
    def light(self) -> Footage:
        """The same at 20 frames a second."""
        return disturbances.at_rate(self.fine, FINE)

    @cached_property
    def plain(self) -> Footage:
        """The same with the usual noise: nothing disturbed."""
        return self.sensed(self.light)

    @cached_property
    def empty(self) -> Footage:
        """`light` without the ball."""
        return self.studio.film(self._circle(), 2.5, self.studio.follow, empty=True)

    @cached_property
    def swift(self) -> Footage:
        """A ball at 40 cm/s before a still head, fine and noiseless."""
        return self.studio.film(self._circle(0.4), 2.0, self.studio.stare_at(self._center), fps=20 * FINE)

    def hidden(self, hidden_s: float) -> Footage:
        """Passes behind a board that hides it for so long."""
        return self._passes_board(hidden_s, hidden_s, share=None)

    def partly_hidden(self, share: float) -> Footage:
        """Passes behind a board that hides the lower share of it for a second."""
        return self._passes_board(1.0, 1.0 if share > 0 else 0.0, share)

    def _passes_board(self, passing_s: float, board_s: float, share: float | None) -> Footage:
        middle_s = 1.2 + RADIUS_M / PASSING_M_S + passing_s / 2
        start = np.array([self._center[0], -PASSING_M_S * middle_s, self._center[2]])
        velocity = PASSING_M_S * _ASIDE
        nearer, drop = _BOARD_M / _FAR_M, start[2] - EYES_M[2]
        top = 0.15 if share is None else nearer * (drop - RADIUS_M + 2 * RADIUS_M * share)
        height = nearer * drop if share is None else top - 0.15
        place = Placed(EYES_M + np.array([-_BOARD_M, 0.0, height]), rotation=_FACING)
        props: Mapping[str, Placed] = {f"board {board_s}": place} if board_s > 0 else {}
        film = self.studio.film(
            lambda t: (start + t * velocity, velocity), 2 * middle_s, self.studio.follow, props=lambda _: props
        )
        return self.sensed(film if share is None else replace(film, seen=np.ones_like(film.seen)))

    def crossed(self, gap_radii: float, prop: str, depth_ratio: float) -> Footage:
        """After a second another ball crosses the view at 30 cm/s, its centre passing the first's at a gap (in
        radii, as seen); it is `depth_ratio` times as far away."""
        motion, middle_s = self._circle(0.08, 0.6), 2.0
        passed = motion(middle_s)[0] + gap_radii * RADIUS_M * np.array([0.0, 0.0, 1.0])

        def props(t: float) -> Mapping[str, Placed]:
            seen_at = passed + 0.3 * (t - middle_s) * _ASIDE
            return {prop: Placed(EYES_M + depth_ratio * (seen_at - EYES_M))} if t > 1.0 else {}

        return self.sensed(self.studio.film(motion, 3.2, self.studio.stare_at(self._center), props=props))

    def two(self, gap_radii: float) -> Footage:
        """Two balls of different colours that circle against each other, a gap (in radii) between their
        middles, the second 8 cm behind; either will do."""
        motion = self._circle(0.12, 0.7)
        apart = np.array([-0.08, gap_radii * RADIUS_M, 0.0])

        def other(t: float) -> Array:
            return 2 * self._center - motion(t)[0] + apart

        film = self.studio.film(
            motion, 2.5, self.studio.stare_at(self._center), props=lambda t: {"other": Placed(other(t))}
        )
        return replace(self.sensed(film), or_position=np.array([other(t) for t in film.stamps_s]))

    def dash(self, frames_in_view: float) -> Footage:
        """After a second at one side of the view it dashes to the other, as fast as would cross the whole view
        in so many frames; asked about the dash and 0.3 s after it."""
        side, width_m = 0.17 * _ASIDE, 320 / 220 * _FAR_M
        takes_s = 0.34 / width_m * frames_in_view / 20
        hover = self._circle(0.05, 0.2, self._center - side)

        def motion(t_s: float) -> tuple[Array, Array]:
            position, velocity = hover(t_s)
            done = float(np.clip((t_s - 1.0) / takes_s, 0, 1))
            return position + 2 * done * side, velocity + (2 * side / takes_s if 0 < done < 1 else 0.0)

        film = self.studio.film(motion, 1.3 + takes_s, self.studio.stare_at(self._center))
        return replace(self.sensed(film), asked=film.stamps_s > 1.0)

    def leaves(self, out_s: float) -> Footage:
        """Leaves the view at 50 cm/s, is out of it for so long, and comes back."""
        hover, speed, way = self._circle(0.08, 0.5), 0.5, 0.36 if out_s > 0 else 0.0
        there, back = 1.2 + way / speed, 1.2 + way / speed + out_s

        def motion(t_s: float) -> tuple[Array, Array]:
            position, velocity = hover(t_s)
            aside = float(np.interp(t_s, [1.2, there, back, back + way / speed], [0, way, way, 0]))
            moving = speed * (float(1.2 < t_s < there) - float(back < t_s < back + way / speed))
            return position + aside * _ASIDE, velocity + moving * _ASIDE

        return self.sensed(self.studio.film(motion, back + way / speed + 1.2, self.studio.stare_at(self._center)))

    def sized(self, diameter_px: float) -> Footage:
        """A ball whose image is so large."""
        radius = 0.5 * diameter_px / 220 * _FAR_M
        ball = make_stimulus("ball", radius)
        return self.sensed(self.studio.film(self._circle(), 2.0, self.studio.follow, stimulus=ball))

    def far(self, distance_m: float) -> Footage:
        """As far away, as much larger and faster, so that it looks the same but for the disparity."""
        scale = distance_m / _FAR_M
        center = EYES_M + scale * (self._center - EYES_M)
        ball = make_stimulus("ball", RADIUS_M * scale)
        motion = self._circle(0.15 * scale, scale, center)
        return self.sensed(self.studio.film(motion, 2.0, self.studio.follow, stimulus=ball))

    def textured(self, contrast: float) -> Footage:
        """A ball of two reds in patches; contrast 0 is one red."""
        return self.sensed(self.studio.film(self._circle(), 2.0, self.studio.follow, stimulus=_patched(contrast)))

    def arm_moves(self, speed_rad_s: float) -> Footage:
        """A ball before the left forearm, whose elbow and wrist swing by 8° at up to so many rad/s."""
        robot, amplitude = self.studio.robot, np.deg2rad(8.0)
        taxels, normals = icub_skin().at(robot.at(home(robot)))
        center = (taxels + 0.14 * normals).mean(axis=0)
        arm = robot.indices(robot.names.arm("left"))
        swing = np.array([0.5, 0.5, 0.5, 1.0, 1.0, 0.0, 0.0])
        rest = gaze_at(robot, home(robot), center)

        def pose(t: float, _: Array, __: Array) -> Array:
            q = rest.copy()
            q[arm] += amplitude * np.sin(speed_rad_s / amplitude * t) * swing
            return robot.clamp(q)

        return self.sensed(self.studio.film(self._circle(0.12, 0.6, center), 2.5, pose))


def _patched(contrast: float) -> Stimulus:
    """The ball with every other patch of its surface darkened."""
    mesh = trimesh.creation.icosphere(4, RADIUS_M)
    middle = mesh.triangles_center / RADIUS_M
    azimuth, height = np.arctan2(middle[:, 1], middle[:, 0]), np.arcsin(np.clip(middle[:, 2], -1, 1))
    dark = (np.floor(azimuth * 5 / np.pi) + np.floor(height * 5 / np.pi)) % 2 > 0
    plain, patches = mesh.submesh([np.flatnonzero(~dark), np.flatnonzero(dark)], repair=False)
    r, g, b = RED
    darker = (r * (1 - 0.5 * contrast), g, b)
    return Stimulus("ball", RADIUS_M, (Part(plain, RED), Part(patches, darker)))

"""Severity of sixteen disturbances of a red ball in view: where tracking breaks, ours beside the baselines.

Success: the track is near (within a sixth of the ball's distance) in frames 0.5 s after the ball comes into view. A
method breaks where success falls below 90 %. Ours has to find the ball; baselines get its true boxes in the first
frame.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pps_vision.experiments.charts import PAGE_IN, panels
from pps_vision.experiments.films import disturbances as d
from pps_vision.experiments.films.recordings import EYES_M, Footage, PosePolicy, film, follow, stare_at, watching
from pps_vision.experiments.films.score import METRICS, baseline, tracker
from pps_vision.experiments.study import NOISE_SIGMA, Axis, Break, Method, SceneSource, compare_severities
from pps_vision.robot.icub import load_icub
from pps_vision.types import Array
from rendering.motions import Circle, Motion
from rendering.scene import PropPose
from rendering.shapes import Part, board, sphere
from rendering.stimuli import RED, make_stimulus

FINE = 5  # frames of a fine recording for each of the usual 20 a second
_BREAK = Break("near_percent", 90.0, above=False)
_RADIUS_M = 0.035
_FAR_M = 0.42
_BOARD_M = 0.36
_PASSING_M_S = 0.12
_FAILS_S = 1.0  # start of a failure
_ASIDE = np.array([0.0, 1.0, 0.0])
_UP = np.array([0.0, 0.0, 1.0])
_FACING = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # a board's normal towards the robot
_METRICS = {"near_percent": METRICS["near_percent"]}
METHODS: dict[str, Method] = {
    "ours, generic": tracker("generic"),
    "ours, marker": tracker("marker"),
    **{name: baseline(name) for name in ("two CSRT", "two KCF", "two CamShift")},
}

Disturb = Callable[[SceneSource, int, float], Footage]  # scene source, seed and severity to a recording


def run(study: Any) -> dict[str, Any]:
    """Return the results of `compare_severities` by scene source and disturbance, of a quarter of the recordings."""
    seeds = study.seeds[: max(study.n // 4, 1)]
    return {
        source: {
            name: compare_severities(partial(disturb, source), axis, METHODS, _METRICS, seeds, _BREAK)
            for name, (axis, disturb) in DISTURBANCES.items()
            if name in (study.disturbances or DISTURBANCES)
        }
        for source in study.sources
    }


def chart(numbers: dict[str, Any]) -> Figure:
    """Draw where each method breaks under each disturbance, one panel a scene source: the earlier, the darker."""
    sources = [source for source in ("rendered", "independent") if source in numbers]
    names = list(numbers[sources[0]])
    figure, axes = panels(len(sources), width=PAGE_IN / len(sources), height=1.6 + 0.26 * len(names))
    for axis, source in zip(axes, sources, strict=True):
        studies = [numbers[source][name] for name in names]
        breaks = [[method["breaks_at"] for method in study["methods"].values()] for study in studies]
        counts = [(list(study["severities"]), row) for study, row in zip(studies, breaks, strict=True)]
        shares = [[1.0 if at is None else s.index(at) / len(s) for at in row] for s, row in counts]
        passed = 100 * np.array(shares)
        image = axis.imshow(passed, cmap="YlOrRd_r", vmin=0, vmax=100, aspect="auto")
        for y, x in np.ndindex(passed.shape):
            text = "–" if breaks[y][x] is None else f"{breaks[y][x]:g}"
            axis.text(x, y, text, ha="center", va="center", fontsize=8, color="white" if passed[y, x] < 40 else "0.15")
        axis.set_xticks(range(passed.shape[1]), list(studies[0]["methods"]), rotation=40, ha="right", fontsize=8)
        axis.set_yticks(range(len(names)), names if axis is axes[0] else [], fontsize=8)
        axis.set_title(f"{source} scenes", fontsize=10)
    bar = figure.colorbar(image, ax=axes, location="bottom", shrink=0.6, aspect=40)
    bar.set_label("severities passed before the break (%); number: severity of the break", fontsize=8)
    bar.ax.tick_params(labelsize=8)
    return figure


def _center(seed: int) -> Array:
    """The middle of the ball's motion."""
    rng = np.random.default_rng((seed, 0))
    return EYES_M + np.array([-_FAR_M, *(rng.uniform(-0.04, 0.04, 2) - [0.0, 0.06])])


def _circle(seed: int, speed_m_s: float = 0.15, scale: float = 1.0, center: Array | None = None) -> Motion:
    """A circle in a plane that is oblique to the eyes; `scale` 1 is 6 cm."""
    phase = np.random.default_rng((seed, 1)).uniform(0, 2 * np.pi)
    c = np.cos(phase)
    s = np.sin(phase)
    axes = np.array([[0.5 * c, 0.85, 0.5 * s], [-0.6 * s, 0.1, 0.8 * c]])
    first = axes[0] / np.linalg.norm(axes[0])
    second = axes[1] - (axes[1] @ first) * first
    middle = _center(seed) if center is None else center
    return Circle(middle, np.array([first, second / np.linalg.norm(second)]), 0.06 * scale, speed_m_s)


def _rng(seed: int) -> np.random.Generator:
    """The same for every disturbance."""
    return np.random.default_rng((seed, 2))


def _of_fine(change: Callable[[Footage, int, float], Footage]) -> Disturb:
    """A disturbance of the fine recording by milliseconds."""
    return lambda source, seed, ms: _sensed(change(fine(source, seed), FINE, ms / 1000), seed)


def _of_plain(change: Callable[[Footage, float, np.random.Generator], Footage]) -> Disturb:
    """A disturbance of the sensed recording by percents."""
    return lambda source, seed, percent: change(_sensed(plain(source, seed), seed), percent / 100, _rng(seed))


def _sensed(recording: Footage, seed: int) -> Footage:
    """The recording with the usual sensor noise."""
    return d.noisy(recording, NOISE_SIGMA, _rng(seed))


def _film(
    source: SceneSource,
    seed: int,
    motion: Motion,
    seconds: float,
    pose: PosePolicy | None = None,
    radius_m: float = _RADIUS_M,
    prop: tuple[Part, ...] | None = None,
    placed: Callable[[float], PropPose | None] = lambda _: None,
    **also: Any,
) -> Footage:
    """Film a ball, and one other thing where it is placed, without noise; the eyes follow unless posed."""
    states = watching(
        motion, seconds, pose or follow(load_icub()), props=lambda t: (placed(t),) if prop else (), **also
    )
    return film(states, make_stimulus("ball", radius_m), source, seed=seed, props=(prop,) if prop else ())


@lru_cache(maxsize=2)
def fine(source: SceneSource, seed: int) -> Footage:
    """Return the undisturbed ball, 2.5 s at 100 frames a second without noise."""
    return _film(source, seed, _circle(seed), 2.5, fps=20 * FINE)


def plain(source: SceneSource, seed: int) -> Footage:
    """Return the same at 20 frames a second without noise."""
    return d.at_rate(fine(source, seed), FINE)


def _passes_board(source: SceneSource, seed: int, hidden_s: float, share: float | None = None) -> Footage:
    """The ball passes behind a board that hides it for so long; with a `share` only its lower part, for 1 s."""
    passing_s = hidden_s if share is None else 1.0
    middle_s = 1.2 + _RADIUS_M / _PASSING_M_S + passing_s / 2
    center = _center(seed)
    start = np.array([center[0], -_PASSING_M_S * middle_s, center[2]])
    nearer = _BOARD_M / _FAR_M
    drop = start[2] - EYES_M[2]
    height = nearer * drop
    if share is not None:
        height = nearer * (drop - _RADIUS_M + 2 * _RADIUS_M * share) - 0.15
    place = PropPose(EYES_M + np.array([-_BOARD_M, 0.0, height]), rotation=_FACING)
    is_there = hidden_s > 0 if share is None else share > 0

    def motion(t_s: float) -> tuple[Array, Array]:
        return start + t_s * _PASSING_M_S * _ASIDE, _PASSING_M_S * _ASIDE

    width_m = (_PASSING_M_S * passing_s + 2 * _RADIUS_M + 0.010) * _BOARD_M / _FAR_M
    prop = (board(width_m, 0.3),)  # hides the ball from both eyes at once
    shown = _film(source, seed, motion, 2 * middle_s, prop=prop, placed=lambda _: place if is_there else None)
    return _sensed(shown if share is None else replace(shown, visible=np.ones_like(shown.visible)), seed)


def _twin(source: SceneSource, seed: int, gap_radii: float) -> Footage:
    """After a second an equal ball, nearer to the eyes, crosses the view at 30 cm/s and passes at a gap (in radii)."""
    motion = _circle(seed, 0.08, 0.6)
    middle_s = 2.0
    passed = motion(middle_s)[0] + gap_radii * _RADIUS_M * _UP

    def placed(t: float) -> PropPose | None:
        place = passed + 0.3 * (t - middle_s) * _ASIDE
        return PropPose(EYES_M + 0.75 * (place - EYES_M)) if t > 1.0 else None

    pose = stare_at(load_icub(), _center(seed))
    return _sensed(_film(source, seed, motion, 3.2, pose, prop=(sphere(_RADIUS_M, RED),), placed=placed), seed)


def _dash(source: SceneSource, seed: int, frames_in_view: float) -> Footage:
    """After a second the ball dashes to the other side, as fast as would cross the view in so many frames; asked about
    the dash and 0.3 s after it."""
    side = 0.17 * _ASIDE
    takes_s = 0.34 / (320 / 220 * _FAR_M) * frames_in_view / 20
    hover = _circle(seed, 0.05, 0.2, _center(seed) - side)

    def motion(t_s: float) -> tuple[Array, Array]:
        position, velocity = hover(t_s)
        done = float(np.clip((t_s - 1.0) / takes_s, 0, 1))
        return position + 2 * done * side, velocity + (2 * side / takes_s if 0 < done < 1 else 0.0)

    shown = _film(source, seed, motion, 1.3 + takes_s, stare_at(load_icub(), _center(seed)))
    return replace(_sensed(shown, seed), in_question=shown.stamps_s > 1.0)


def leave_view(source: SceneSource, seed: int, out_s: float) -> Footage:
    """The ball leaves the view at 50 cm/s, is out of it for so long, and comes back."""
    hover = _circle(seed, 0.08, 0.5)
    speed = 0.5
    way = 0.36 if out_s > 0 else 0.0
    there = 1.2 + way / speed
    back = there + out_s

    def motion(t_s: float) -> tuple[Array, Array]:
        position, velocity = hover(t_s)
        aside = float(np.interp(t_s, [1.2, there, back, back + way / speed], [0, way, way, 0]))
        moving = speed * (float(1.2 < t_s < there) - float(back < t_s < back + way / speed))
        return position + aside * _ASIDE, velocity + moving * _ASIDE

    pose = stare_at(load_icub(), _center(seed))
    return _sensed(_film(source, seed, motion, back + way / speed + 1.2, pose), seed)


def _sized(source: SceneSource, seed: int, diameter_px: float) -> Footage:
    """A ball whose image is so large."""
    return _sensed(_film(source, seed, _circle(seed), 2.0, radius_m=0.5 * diameter_px / 220 * _FAR_M), seed)


def _far(source: SceneSource, seed: int, distance_m: float) -> Footage:
    """As far away, as much larger and faster, so that only the disparity differs."""
    scale = distance_m / _FAR_M
    motion = _circle(seed, 0.15 * scale, scale, EYES_M + scale * (_center(seed) - EYES_M))
    return _sensed(_film(source, seed, motion, 2.0, radius_m=_RADIUS_M * scale), seed)


def _faded(source: SceneSource, seed: int, percent: float) -> Footage:
    shown = plain(source, seed)
    return _sensed(d.faded(shown, _film(source, seed, _circle(seed), 2.5, empty=True), percent / 100), seed)


def _swing(source: SceneSource, seed: int, stops: float) -> Footage:
    return _sensed(d.exposed(plain(source, seed), lambda t: stops * float(np.sin(np.pi * t))), seed)


def _eye_fails(source: SceneSource, seed: int, seconds: float) -> Footage:
    recording = _sensed(plain(source, seed), seed)
    stamps_s = recording.stamps_s
    return d.eyes_fail(recording, "black", (stamps_s >= _FAILS_S) & (stamps_s < _FAILS_S + seconds))


_DELAYS_MS = (0, 10, 20, 50, 100)
DISTURBANCES: dict[str, tuple[Axis, Disturb]] = {
    "pixel noise": (Axis("σ (grey levels)", (2, 10, 20, 40, 80)), lambda s, k, v: d.noisy(plain(s, k), v, _rng(k))),
    "exposure": (Axis("up and down by (stops), 2 s period", (0, 1, 2, 3, 4)), _swing),
    "loss of colour": (
        Axis("saturation kept (%)", (100, 25, 10, 5, 0)),
        lambda s, k, v: _sensed(d.desaturated(plain(s, k), v / 100), k),
    ),
    "colour of the background": (Axis("contrast kept (%)", (100, 50, 30, 20, 10)), _faded),
    "hidden": (Axis("by a board for (s)", (0, 0.25, 0.5, 1, 2)), _passes_board),
    "partly hidden": (
        Axis("share, for 1 s (%)", (0, 25, 50, 75, 90)),
        lambda s, k, v: _passes_board(s, k, 1.0, v / 100),
    ),
    "equal ball before": (Axis("passes at (radii)", (4, 2, 1, 0)), _twin),
    "speed": (Axis("frames to cross the view", (40, 20, 10, 5, 3)), _dash),
    "leaves and returns": (Axis("out of view for (s)", (0, 0.1, 0.5, 2)), leave_view),
    "size": (Axis("diameter (px)", (40, 16, 8, 6, 4)), _sized),
    "distance": (Axis("distance (m)", (0.4, 0.8, 1.6)), _far),
    "missing pairs": (Axis("share (%)", (0, 25, 50, 75)), _of_plain(d.dropped)),
    "right eye late, not stamped": (Axis("by (ms)", _DELAYS_MS), _of_fine(d.right_late)),
    "head pose stale": (Axis("by (ms)", _DELAYS_MS), _of_fine(d.stale_joints)),
    "right eye black": (Axis("for (s)", (0, 0.1, 0.25, 0.5, 1)), _eye_fails),
    "intrinsics off": (Axis("by (%)", (0, 1, 2, 3, 5)), _of_plain(d.miscalibrated)),
}

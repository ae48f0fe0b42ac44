"""Positions of taxels, 3 cm off at first, learned from double touches."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from control.double_touch import FINGERTIP_RADIUS_M, DoubleTouch, DoubleTouching
from learning.pps.taxel_positions import PartTouch, verified_positions
from pps_vision.app.encounters.robots import true_robot
from pps_vision.experiments.study import interval
from pps_vision.experiments.tables import Table, estimate, judged
from pps_vision.geometry.se3 import inverse, move_points
from pps_vision.robot.skin import INNER_FOREARM, TOUCH_RADIUS_M, SkinPart
from pps_vision.types import Array

ERROR_M = 0.03  # RMS distance of a taxel from where it is taken to be
AFTER = (0, 25, 50, 100)  # double touches
_SCATTER_M = 0.025  # standard deviation of the aims about the taxels, across their normals: as of R's objects
_DEEPER_M = 0.03  # an aim lies this much below the taxel, so that the finger arrives where the skin is deeper too
_AIMS = 1500  # most aims; every tenth meets a taxel
_GOAL_MM = 10.0


def run(study: Any) -> dict[str, Any]:
    """Return the RMS distance in mm of the inner taxels from their true positions, over skins, and the mean of the felt
    positions of the fingertip beside them."""
    n_touches = [max(round(study.share * n), 2) if n else 0 for n in AFTER]
    errors = []
    felt = []
    for k in range(study.n):
        rng = np.random.default_rng((study.seed, k))
        _, _, skin = true_robot()
        true = skin.parts[0]
        offset = ERROR_M / np.sqrt(3) * rng.standard_normal(true.positions_m.shape)
        believed = replace(true, positions_m=true.positions_m + offset)
        inner = np.array([true.ids.index(i) for i in INNER_FOREARM])
        touches = []
        for touch in double_touches(true, believed, inner, rng):
            touches.append(touch)
            if len(touches) == max(n_touches):
                break
        parts = [verified_positions(believed, touches[:n]) for n in n_touches]
        errors.append([_rms_mm(part.positions_m[inner] - true.positions_m[inner]) for part in parts])
        means = [np.mean([t.center for t in touches if t.touched[i]], axis=0) for i in inner]
        felt.append([_rms_mm(np.array(means) - true.positions_m[inner])])
    by_touches = {str(n): interval([[of_skin[j]] for of_skin in errors]) for j, n in enumerate(n_touches)}
    return {"rms_mm": by_touches, "mean_felt_rms_mm": interval(felt)}


def double_touches(true: SkinPart, believed: SkinPart, inner: Array, rng: np.random.Generator) -> Iterator[PartTouch]:
    """Yield touches of the `true` skin by a right index that is aimed about the `believed` taxels."""
    robot, _, _ = true_robot()
    index = inner[np.arange(_AIMS) % len(inner)]
    normals = believed.normals[index]
    aside = _SCATTER_M * rng.standard_normal((_AIMS, 3))
    aside -= np.sum(aside * normals, axis=1, keepdims=True) * normals
    aims = SkinPart(
        "aims", true.frame, tuple(range(_AIMS)), believed.positions_m[index] + aside - _DEEPER_M * normals, normals
    )
    planner = DoubleTouching(robot, aims)
    for aim in range(_AIMS):
        (plan,) = planner.plan(aim, 1, rng)
        if not isinstance(plan, DoubleTouch):
            continue
        postures = [robot.at(q) for q in plan.joints_rad]
        tips = (p.point(robot.names.index_tips[1]) for p in postures)
        path = np.array(
            [move_points(inverse(p.T_root(true.frame)), tip) for p, tip in zip(postures, tips, strict=True)]
        )
        gaps = np.linalg.norm(path[:, None] - true.positions_m, axis=2).min(axis=1) - FINGERTIP_RADIUS_M
        if not (gaps <= 0).any():
            continue
        k = int((gaps <= 0).argmax())
        share = gaps[k - 1] / (gaps[k - 1] - gaps[k]) if k else 1.0  # share of the last step, at which the finger stops
        center = path[max(k - 1, 0)] + share * (path[k] - path[max(k - 1, 0)])
        distances = np.linalg.norm(center - true.positions_m, axis=1)
        yield PartTouch(center, FINGERTIP_RADIUS_M, distances <= FINGERTIP_RADIUS_M + TOUCH_RADIUS_M)


def _rms_mm(offsets_m: Array) -> float:
    return 1000 * float(np.sqrt(np.mean(np.sum(offsets_m**2, axis=1))))


def table(numbers: dict[str, Any]) -> Table:
    """Return the errors by number of double touches."""
    errors = numbers["rms_mm"]
    cells = [estimate(value) for value in errors.values()]
    cells[-1] = judged(cells[-1], list(errors.values())[-1][0] > _GOAL_MM)
    header = ["double touches", *errors, "mean of the fingertips' positions"]
    return Table(header, [["position error (mm RMS)", *cells, estimate(numbers["mean_felt_rms_mm"])]])

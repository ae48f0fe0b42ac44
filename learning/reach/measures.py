"""Choices of a reachable-space map: the point of an arm that reaches, and the measure of a good posture."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from learning.reach import MeasureName
from learning.reach.labels import HandModel
from learning.reach.params import MapParams
from pps_vision.robot.end_point import EndPoint
from pps_vision.robot.model import Robot
from pps_vision.robot.self_motion import DirectionCoverage, FarFromLimits, Manipulability, Measure
from pps_vision.robot.skin import Skin
from pps_vision.types import Array

_N_SAMPLED = 20_000  # postures among which the greatest manipulability is looked for


def hand_and_params(
    robot: Robot, side: str, end_point: str, measure: MeasureName, params: MapParams, skin: Skin | None = None
) -> tuple[HandModel, MapParams]:
    """Arguments of `train_reachable_map` for an end point ("palm", or a taxel such as "left_forearm:27") and a measure;
    ValueError for a point that this arm does not carry."""
    lower, upper = np.array([params.arm_limits.lower_rad, params.arm_limits.upper_rad])
    point = EndPoint.of(robot, side, end_point, len(lower), skin)
    hand = replace(HandModel.of(robot, point.positions), normals=point.normals)
    return hand, replace(params, measure=_measure(measure, point, lower, upper))


def _measure(
    name: MeasureName, point: EndPoint, lower: Array, upper: Array
) -> Callable[[Array, Array], Measure] | DirectionCoverage:
    if name == "approach":
        return DirectionCoverage()
    if name == "joint-limits":
        return FarFromLimits
    if name == "isotropy":
        return lambda _lower, _upper: Manipulability(isotropy=True)
    q = np.random.default_rng(0).uniform(lower, upper, (_N_SAMPLED, len(lower)))
    most = float(Manipulability()(q, point.positions(q)[1]).max())
    return lambda _lower, _upper: Manipulability(most)

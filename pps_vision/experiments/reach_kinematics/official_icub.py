"""Axes and limits of the joints of the official iCub models (package icub-models) beside ours, all joints at 0."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pps_vision.experiments.tables import Table
from pps_vision.robot.icub import load_icub
from pps_vision.types import Array


@dataclass(frozen=True)
class JointDifference:
    """Difference of a joint's axis from ours, in the root frame."""

    joint: str  # our name
    angle_deg: float  # angle between the axes
    offset_m: float  # distance of the origin of our joint from the official axis
    limits_deg: list[float]  # limits of the official model
    our_limits_deg: list[float]  # limits of ours


def run(names: Sequence[str]) -> dict[str, Any]:
    """Return the differences by model."""
    import icub_models

    files = {name: icub_models.get_model_file(name) for name in names}
    return {"models": {name: [asdict(row) for row in compare_joints(file)] for name, file in files.items()}}


def compare_joints(urdf: Path) -> list[JointDifference]:
    """Compare the joints of torso, neck and left arm; the right arm mirrors the left one."""
    official = pin.buildModelFromUrdf(str(urdf))
    ours = load_icub().model
    rows = []
    for joint in ours.names[1:]:
        name = joint.replace("left_", "l_").replace("prosupination", "prosup")
        if joint.startswith("right_") or not official.existJointName(name):
            continue
        (v, w), _, limits_deg = _joint(official, name)
        (_, our_w), our_origin, our_limits_deg = _joint(ours, joint)
        angle = np.rad2deg(np.arctan2(np.linalg.norm(np.cross(w, our_w)), w @ our_w))
        offset = np.linalg.norm(np.cross(our_origin - np.cross(w, v), w))  # w × v is on the axis
        rows.append(JointDifference(joint, float(angle), float(offset), limits_deg, our_limits_deg))
    return rows


def _joint(model: pin.Model, name: str) -> tuple[list[Array], Array, list[float]]:
    """Screw [v, ω] of a joint in the root frame, all joints at 0, its origin (3,), and its limits in degrees."""
    data = model.createData()
    i = model.getJointId(name)
    screw = pin.computeJointJacobians(model, data, pin.neutral(model))[:, i - 1]
    limits = np.rad2deg([model.lowerPositionLimit[i - 1], model.upperPositionLimit[i - 1]])
    return np.split(screw, 2), data.oMi[i].translation.copy(), limits.tolist()


def table(numbers: dict[str, Any]) -> Table:
    """Return distances in mm and limits in degrees, and the largest angle between axes."""
    models = numbers["models"]
    rows = []
    for joints in zip(*models.values(), strict=True):
        cells = [joints[0]["joint"].replace("_", " "), "{:.0f} to {:.0f}".format(*joints[0]["our_limits_deg"])]
        for row in joints:
            cells += [f"{1000 * row['offset_m']:.1f}", "{:.0f} to {:.0f}".format(*row["limits_deg"])]
        rows.append(cells)
    largest = max(row["angle_deg"] for joints in models.values() for row in joints)
    rows.append(["largest angle between axes (°)", "", f"{largest:.3f}", *[""] * (2 * len(models) - 1)])
    columns = [f"{name}: {column}" for name in models for column in ("axis (mm)", "limits (°)")]
    return Table(["joint", "our limits (°)", *columns], rows)

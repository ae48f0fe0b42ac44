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
    limits_deg: tuple[float, float]  # limits of the official model
    our_limits_deg: tuple[float, float]  # limits of ours


def run(names: Sequence[str]) -> dict[str, Any]:
    """Return the differences by model."""
    import icub_models

    files = {name: icub_models.get_model_file(name) for name in names}
    return {"models": {name: [asdict(row) for row in compare_joints(file)] for name, file in files.items()}}


def compare_joints(urdf: Path) -> list[JointDifference]:
    """Compare the joints of torso, neck and left arm; the right arm mirrors the left one."""
    official = pin.buildModelFromUrdf(str(urdf))
    ours = load_icub().model
    axes, _ = _axes(official)
    our_axes, our_origins = _axes(ours)
    rows = []
    for joint in ours.names:
        name = joint.replace("left_", "l_").replace("prosupination", "prosup")
        if joint.startswith("right_") or not official.existJointName(name) or joint == "universe":
            continue
        i = official.getJointId(name) - 1
        k = ours.getJointId(joint) - 1
        v, w = np.split(axes[:, i], 2)
        our_w = our_axes[3:, k]
        angle = np.rad2deg(np.arctan2(np.linalg.norm(np.cross(w, our_w)), w @ our_w))
        offset = np.linalg.norm(np.cross(our_origins[k] - np.cross(w, v), w))  # w × v is on the axis
        rows.append(JointDifference(joint, float(angle), float(offset), _limits_deg(official, i), _limits_deg(ours, k)))
    return rows


def _axes(model: pin.Model) -> tuple[Array, list[Array]]:
    """(6, n) screws (v, ω) of the joints at 0 in the root frame, and their origins (3,)."""
    data = model.createData()
    screws = np.array(pin.computeJointJacobians(model, data, pin.neutral(model)))
    return screws, [data.oMi[i].translation.copy() for i in range(1, model.njoints)]


def _limits_deg(model: pin.Model, i: int) -> tuple[float, float]:
    lower, upper = np.rad2deg([model.lowerPositionLimit[i], model.upperPositionLimit[i]])
    return float(lower), float(upper)


def table(numbers: dict[str, Any]) -> Table:
    """Return distances in mm and limits in degrees, and the largest angle between axes."""
    models = numbers["models"]
    rows = []
    for joints in zip(*models.values(), strict=True):
        cells = [
            cell
            for row in joints
            for cell in (f"{1000 * row['offset_m']:.1f}", "{:.0f} to {:.0f}".format(*row["limits_deg"]))
        ]
        rows.append(
            [joints[0]["joint"].replace("_", " "), "{:.0f} to {:.0f}".format(*joints[0]["our_limits_deg"]), *cells]
        )
    largest = max(row["angle_deg"] for joints in models.values() for row in joints)
    rows.append(["largest angle between axes (°)", "", f"{largest:.3f}", *[""] * (2 * len(models) - 1)])
    columns = [f"{name}: {column}" for name in models for column in ("axis (mm)", "limits (°)")]
    return Table(["joint", "our limits (°)", *columns], rows)

"""The official iCub models (package icub-models) against our kinematics, joint by joint."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pps_vision.experiments.study import Study
from pps_vision.experiments.tables import Table
from pps_vision.robot.icub import load_icub
from pps_vision.types import Array


@dataclass(frozen=True)
class JointDifference:
    """How far a joint's axis is from ours with all joints at 0, in the root frame."""

    joint: str
    """Our name."""
    angle_deg: float
    """Between the axes."""
    offset_m: float
    """From the origin of our joint to the other axis."""
    limits_deg: tuple[float, float]
    """Of the official model."""
    our_limits_deg: tuple[float, float]
    """Of ours."""


@dataclass(frozen=True)
class OfficialICub(Study):
    """Axes and limits of the joints of the official iCub models against ours, all joints at 0."""

    models: tuple[str, ...] = ("iCubLisboa01", "iCubGazeboV2_5")
    """Names of models; of version 1, as ours, and of version 2.5."""

    def run(self) -> dict[str, Any]:
        """Return the differences by model."""
        import icub_models

        files = {name: icub_models.get_model_file(name) for name in self.models}
        return {"models": {name: [asdict(row) for row in compare_joints(file)] for name, file in files.items()}}

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return distances in mm and limits in degrees; angles are all below a hundredth of a degree, or shown."""
        models = numbers["models"]
        head = [
            "joint",
            "our limits (°)",
            *(f"{name}: {what}" for name in models for what in ("axis (mm)", "limits (°)")),
        ]
        rows = []
        for same in zip(*models.values(), strict=True):
            cells = [cell for row in same for cell in (f"{1000 * row['offset_m']:.1f}", _range(row["limits_deg"]))]
            rows.append([same[0]["joint"].replace("_", " "), _range(same[0]["our_limits_deg"]), *cells])
        largest = max(row["angle_deg"] for of in models.values() for row in of)
        rows.append(["largest angle between axes (°)", "", *(f"{largest:.3f}", *[""] * (2 * len(models) - 1))])
        return {"": Table(head, rows)}


def _range(limits: tuple[float, float]) -> str:
    return f"{limits[0]:.0f} to {limits[1]:.0f}"


def compare_joints(urdf: Path) -> list[JointDifference]:
    """The joints of torso, neck and left arm of an official model; the right arm mirrors the left one."""
    theirs = pin.buildModelFromUrdf(str(urdf))
    ours = load_icub().model
    (axes, _), (our_axes, our_origins) = _axes(theirs), _axes(ours)
    rows = []
    for joint in ours.names:
        official = joint.replace("left_", "l_").replace("prosupination", "prosup")
        if joint.startswith("right_") or not theirs.existJointName(official) or joint == "universe":
            continue
        i, k = theirs.getJointId(official), ours.getJointId(joint)
        (v, w), w_ours = np.split(axes[:, i - 1], 2), our_axes[3:, k - 1]
        angle = np.rad2deg(np.arctan2(np.linalg.norm(np.cross(w, w_ours)), w @ w_ours))
        offset = np.linalg.norm(np.cross(our_origins[k - 1] - np.cross(w, v), w))  # w × v is on the axis
        rows.append(JointDifference(joint, float(angle), float(offset), _limits(theirs, i), _limits(ours, k)))
    return rows


def _axes(model: pin.Model) -> tuple[Array, list[Array]]:
    """(6, n) screws (v, ω) of the joints at 0 in the root frame, and their origins (3,)."""
    data, q = model.createData(), pin.neutral(model)
    screws = np.array(pin.computeJointJacobians(model, data, q))
    return screws, [data.oMi[i].translation.copy() for i in range(1, model.njoints)]


def _limits(model: pin.Model, joint: int) -> tuple[float, float]:
    index = joint - 1
    return (
        float(np.rad2deg(model.lowerPositionLimit[index])),
        float(np.rad2deg(model.upperPositionLimit[index])),
    )

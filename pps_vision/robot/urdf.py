"""A URDF made safe for Pinocchio: bounded, its joints and shapes checked, its meshes replaced by their bounding boxes.

Continuous joints become revolute ones from −π to π.

Pinocchio's parser ends the process for a deep model, and the readers of meshes hang or crash on some files; those run
in a process of their own (`mesh_bounds`).
"""

import json
import math
import os
import subprocess
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement, TreeBuilder, tostring
from xml.parsers import expat

import numpy as np
import pinocchio as pin

from pps_vision.errors import InputError
from pps_vision.files import check_regular, read_bytes

_EXPECTED = "expected a URDF"
_MOST_BYTES = 2**24
_MOST_LINKS = 1000
_MOST_DEPTH = 32  # of XML
_MOST_TURN_RAD = 4 * math.pi  # limits beyond two turns are degrees
_MESHES_S = 60.0
_SHAPES = {"sphere": ("radius",), "cylinder": ("radius", "length"), "box": ("size",)}


class Follower(NamedTuple):
    """A joint that mimics another: its position is factor times its master's plus an offset (rad, m)."""

    joint: str
    master: str
    factor: float
    offset: float


def names_in(file: Path) -> tuple[list[str], list[str]]:
    """Return the names of the links, and of the joints that move by themselves; InputError as of `read_urdf`."""
    root = _Urdf(file).root
    moving = [item for item in root.iterfind("joint") if item.get("type") != "fixed" and item.find("mimic") is None]
    return [link.get("name", "") for link in root.iterfind("link")], [joint.get("name", "") for joint in moving]


def read_urdf(file: Path) -> tuple[str, tuple[Follower, ...]]:
    """Return the text of a URDF file without collision shapes and meshes, and the joints that mimic others.

    A mesh that is not found is left out, with a warning.

    Raises:
        InputError: Names line and joint or link of an impossible entry, or the mesh that cannot be read.
    """
    urdf = _Urdf(file)
    joints = urdf.root.findall("joint")
    for joint in joints:
        urdf.check_joint(joint)
    masters = [joint.get("name") for joint in joints if joint.get("type") != "fixed" and joint.find("mimic") is None]
    followers = tuple(urdf.follower(joint, masters) for joint in joints if joint.find("mimic") is not None)
    links = urdf.root.findall("link")
    if len(links) > _MOST_LINKS:
        raise InputError(file, f"{len(links)} links; expected at most {_MOST_LINKS}")
    for link in links:
        for collision in link.findall("collision"):
            link.remove(collision)
    for link in links:
        for shape in link.iterfind("visual/geometry/*"):
            urdf.check_shape(link, shape)
    urdf.replace_meshes()
    return tostring(urdf.root, encoding="unicode"), followers


class _Urdf:
    """The elements of a URDF, and their lines for messages."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self._lines: dict[Element, int] = {}
        builder = TreeBuilder()
        parser = expat.ParserCreate()
        depth = 0

        def start(tag: str, attributes: dict[str, str]) -> None:
            nonlocal depth
            depth += 1
            self._lines[builder.start(tag, attributes)] = parser.CurrentLineNumber
            if depth > _MOST_DEPTH:
                raise InputError(file, f"more than {_MOST_DEPTH} levels; {_EXPECTED}", parser.CurrentLineNumber)

        def end(tag: str) -> None:
            nonlocal depth
            depth -= 1
            builder.end(tag)

        def refuse(*_: object) -> None:
            raise InputError(file, f"a declaration <!…>; {_EXPECTED}", parser.CurrentLineNumber)

        parser.StartElementHandler = start
        parser.EndElementHandler = end
        parser.EntityDeclHandler = refuse
        try:
            parser.Parse(read_bytes(file, "a URDF", _MOST_BYTES), True)
        except expat.ExpatError as error:
            raise InputError(file, f"cannot be read as URDF: {error}; {_EXPECTED}", error.lineno) from error
        self.root = builder.close()
        if self.root.tag != "robot":
            raise InputError(file, f"cannot be read as URDF: <{self.root.tag}>; expected <robot>", 1)

    def refuse(self, element: Element, message: str) -> InputError:
        """The error of an element."""
        return InputError(self.file, message, self._lines[element])

    def numbers(self, element: Element, name: str, default: str = "") -> list[float]:
        """The finite numbers of an attribute."""
        text = element.get(name, default)
        try:
            values = [float(word) for word in text.split()]
        except ValueError:
            values = [math.nan]
        if not values or not all(map(math.isfinite, values)):
            raise self.refuse(element, f"{element.tag} with {name} {text!r}; expected finite numbers")
        return values

    def check_joint(self, joint: Element) -> None:
        """InputError for a joint that cannot move; a continuous one gets limits."""
        name = f"joint {joint.get('name')!r}"
        kind = joint.get("type")
        if kind not in ("fixed", "revolute", "prismatic", "continuous"):
            raise self.refuse(joint, f"{name} is {kind}; expected revolute, continuous, prismatic or fixed joints")
        if kind == "fixed":
            return
        axis = joint.find("axis")
        if axis is not None and not np.linalg.norm(self.numbers(axis, "xyz", "1 0 0")) > 1e-6:
            raise self.refuse(axis, f"{name} has an axis without length; expected a direction")
        limit = joint.find("limit")
        if kind == "continuous":
            joint.set("type", "revolute")
            if limit is None:
                limit = SubElement(joint, "limit", effort="0", velocity="0")
            limit.set("lower", repr(-math.pi))
            limit.set("upper", repr(math.pi))
        if limit is None:
            raise self.refuse(joint, f"{name} has no limit; expected lower and upper")
        lower, upper = (self.numbers(limit, key, "0")[0] for key in ("lower", "upper"))
        largest = math.inf if kind == "prismatic" else _MOST_TURN_RAD
        if not -largest <= lower <= upper <= largest:
            expected = "lower ≤ upper" + (", within two turns, in radians" if kind == "revolute" else "")
            raise self.refuse(limit, f"{name} from {lower:g} to {upper:g}; expected {expected}")

    def follower(self, joint: Element, masters: Sequence[str | None]) -> Follower:
        """The joint that mimics another; InputError unless that moves by itself."""
        mimic = joint.find("mimic")
        assert mimic is not None  # by the choice of `joint`
        name, master = joint.get("name", ""), mimic.get("joint", "")
        if master not in masters or joint.get("type") == "fixed":
            raise self.refuse(mimic, f"joint {name!r} mimics {master!r}; expected a joint that moves by itself")
        factor, offset = self.numbers(mimic, "multiplier", "1")[0], self.numbers(mimic, "offset", "0")[0]
        return Follower(name, master, factor, offset)

    def check_shape(self, link: Element, shape: Element) -> None:
        """InputError for a shape without extent."""
        for key in _SHAPES.get(shape.tag, ()):
            values = self.numbers(shape, key)
            if len(values) != (3 if key == "size" else 1) or not min(values) > 0:
                text = f"link {link.get('name')!r} has a {shape.tag} of {key} {shape.get(key)}"
                raise self.refuse(shape, f"{text}; expected a positive {key}")

    def replace_meshes(self) -> None:
        """Put a box in the place of every mesh that is found; warn of the others, which are left out."""
        visuals, files, missing = [], [], []
        for link in self.root.iterfind("link"):
            for visual in link.findall("visual"):
                if (mesh := visual.find("geometry/mesh")) is None:
                    continue
                if file := self._mesh_file(mesh.get("filename", "")):
                    visuals.append(visual)
                    files.append(file)
                else:
                    link.remove(visual)
                    missing.append(mesh)
        if missing:
            place = f"{self.file}:{self._lines[missing[0]]}: mesh {missing[0].get('filename')}"
            others = f" and {len(missing) - 1} others are" if missing[1:] else " is"
            where = "the folders above, in those of ROS_PACKAGE_PATH and of AMENT_PREFIX_PATH"
            warnings.warn(f"{place}{others} in none of {where}; left out, no body is there", stacklevel=2)
        bounds = dict(zip(dict.fromkeys(files), mesh_bounds(tuple(dict.fromkeys(files))), strict=True))
        for visual, file in zip(visuals, files, strict=True):
            geometry = visual.find("geometry")
            mesh = visual.find("geometry/mesh")
            assert geometry is not None  # by the choice of `visuals`
            assert mesh is not None
            low, high = np.multiply(bounds[file], self.numbers(mesh, "scale", "1 1 1"))
            geometry.remove(mesh)
            SubElement(geometry, "box", size=_words(np.abs(high - low)))
            origin = visual.find("origin")
            if origin is None:
                origin = SubElement(visual, "origin")
            xyz, rpy = (np.array(self.numbers(origin, key, "0 0 0")) for key in ("xyz", "rpy"))
            origin.set("xyz", _words(xyz + pin.rpy.rpyToMatrix(rpy) @ (0.5 * (low + high))))

    def _mesh_file(self, name: str) -> Path | None:
        """The file of a mesh, None if there is none: below the URDF's folder or one of those above; package://PACKAGE/…
        also in the folders of ROS_PACKAGE_PATH (packages or what holds them) and AMENT_PREFIX_PATH (share/PACKAGE)."""
        relative = Path(name.removeprefix("package://").removeprefix("file://"))
        folders = [*self.file.resolve().parents, *_folders("ROS_PACKAGE_PATH")]
        places = [folder / relative for folder in folders]
        places += [prefix / "share" / relative for prefix in _folders("AMENT_PREFIX_PATH")]
        if name.startswith("package://") and len(relative.parts) > 1:
            package, *below = relative.parts
            for folder in _folders("ROS_PACKAGE_PATH"):
                packages = [folder] * (folder.name == package) + [
                    file.parent for file in folder.glob(f"*/{package}/package.xml")
                ]
                places += [Path(found, *below) for found in packages]
        file = next((place for place in places if place.exists()), None)
        if file is not None:
            check_regular(file, "a mesh")
        return file


def _folders(variable: str) -> list[Path]:
    """The folders that an environment variable lists."""
    return [*map(Path, filter(None, os.environ.get(variable, "").split(":")))]


def _words(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def mesh_bounds(files: Sequence[Path]) -> Iterator[tuple[list[float], list[float]]]:
    """Yield the lowest and highest coordinates (3,) of each mesh, read in another process; InputError names the first
    mesh that cannot be read, crashes its reader or takes longer than a minute."""
    if not files:
        return
    command = [sys.executable, "-P", str(Path(__file__).with_name("mesh_bounds.py")), *map(str, files)]
    try:
        process = subprocess.run(command, capture_output=True, text=True, timeout=_MESHES_S)
        output = process.stdout
        reason = "cannot be read"
    except subprocess.TimeoutExpired as expired:
        output = (expired.stdout or b"").decode()
        reason = f"takes longer than {_MESHES_S:g} s"
    lines = output.split("\n")[:-1]
    if len(lines) < len(files):
        raise InputError(files[len(lines)], f"{reason}; expected a mesh (STL, OBJ, DAE, …)")
    for file, line in zip(files, lines, strict=True):
        low, high = json.loads(line)
        if not np.isfinite([low, high]).all():
            raise InputError(file, "has no extent; expected a mesh of finite size")
        yield low, high

"""Calibrations of other tools than OpenCV, as OpenCV's matrices.

| tool | recognised by | holds |
|---|---|---|
| Kalibr, camchain YAML | `cam0`, `cam1` | both cameras, `T_cn_cnm1` |
| ROS, camera_info YAML | `projection_matrix` | one camera; the baseline is in the right one's |
| EuRoC/ASL, sensor.yaml | `T_BS` | one camera and its pose in the body's frame |
| KITTI, calib.txt | `P0:`, or `P_rect_00:` | the projections of rectified cameras; a pair of them is chosen |
| aniposelib, TOML | `[cam_0]` | all cameras; the first two count |
"""

import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from pps_vision.errors import InputError, first_line
from pps_vision.geometry.se3 import inverse, transform
from pps_vision.recordings.text import finite
from pps_vision.types import Array

_MOST_CHARACTERS = 2**18
_MOST_NODES = 2000
_MAX_DEPTH = 16  # of YAML
_LARGEST = 1e9  # of any number in a calibration; keeps products finite
_KITTI = re.compile(r"^P(?:_rect_0)?([0-9]):(.*)$", re.MULTILINE)
_LENSES = ("radtan", "radial-tangential", "plumb_bob", "none")  # k1, k2, p1, p2 (and k3) of one model

Matrices = dict[str, Array]
"""K, D, image_width, image_height and pose (p_camera = pose p_reference) of a file of one camera; with 1 and 2 behind
their names those of both."""


def read_matrices(file: Path, text: str, cameras: tuple[int, int]) -> Matrices | None:
    """Return the cameras of a calibration of one of these tools, None for any other file; lengths in its own unit.

    `cameras`: which of KITTI's are left and right. InputError if it is of one of these tools and cannot be used.
    """
    if text.startswith(("%YAML", "<", "{")) or "opencv-matrix" in text:
        return None
    if len(text) > _MOST_CHARACTERS or len(re.findall(r"[\[{.=]|-\s", text)) > 4 * _MOST_NODES:
        raise InputError(file, f"has more than {_MOST_CHARACTERS} characters or is nested; expected a calibration")
    if _KITTI.search(text):
        return _pair([_kitti(file, text, camera) for camera in cameras])
    if re.search(r"^\s*\[[\w\"-]+\]\s*$", text, re.MULTILINE):
        return _pair(_anipose(file, text))
    content = parse_yaml(file, text)
    if not isinstance(content, Mapping):
        return None
    if "projection_matrix" in content:
        return ros_matrices(file, content)
    if "T_BS" in content:
        return _intrinsics(file, content) | {"pose": inverse(numbers_of(file, content, "T_BS", 4, 4))}
    if "cam0" in content and "cam1" in content:
        left, right = (_table(file, content, name) for name in ("cam0", "cam1"))
        T_right_left = numbers_of(file, right, "T_cn_cnm1", 4, 4)
        poses = {"pose1": np.eye(4), "pose2": T_right_left}
        return _pair([_intrinsics(file, left), _intrinsics(file, right)]) | poses
    return None


def _intrinsics(file: Path, content: Mapping[str, Any]) -> Matrices:
    """The entries that Kalibr and EuRoC share."""
    if (model := content.get("camera_model", "pinhole")) != "pinhole":
        raise InputError(file, f"camera_model {model}; expected pinhole")
    _check_lens(file, content)
    fx, fy, cx, cy = numbers_of(file, content, "intrinsics", 4)
    width, height = numbers_of(file, content, "resolution", 2)
    key = "distortion_coeffs" if "distortion_coeffs" in content else "distortion_coefficients"
    return _sized(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), numbers_of(file, content, key), width, height)


def ros_matrices(file: Path, content: Mapping[str, Any]) -> Matrices:
    """The matrices of a camera_info; InputError if it cannot be used.

    p_rectified = R p_camera, and P = [K' | K' t] of the rectified camera, which is t beside the left one."""
    _check_lens(file, content)
    P = numbers_of(file, content, "projection_matrix", 3, 4)
    beside = transform(None, _translation(file, P))
    rectified = transform(numbers_of(file, content, "rectification_matrix", 3, 3))
    width, height = (numbers_of(file, content, f"image_{side}", 1)[0] for side in ("width", "height"))
    lens = numbers_of(file, content, "distortion_coefficients")
    K = numbers_of(file, content, "camera_matrix", 3, 3)
    return _sized(K, lens, width, height) | {"pose": inverse(rectified) @ beside}


def _kitti(file: Path, text: str, camera: int) -> Matrices:
    """Rectified cameras have no distortion and one orientation."""
    rows = [words for name, words in _KITTI.findall(text) if name == str(camera)]
    if len(rows) != 1:
        raise InputError(file, f"P{camera} {len(rows)} times; expected it once, with 12 numbers")
    P = numbers_of(file, {f"P{camera}": rows[0].split()}, f"P{camera}", 3, 4)
    return {"K": P[:, :3], "pose": transform(None, _translation(file, P))}


def _anipose(file: Path, text: str) -> list[Matrices]:
    """p_camera = R p_world + t."""
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a number of too many digits is a plain ValueError
        raise InputError(file, f"cannot be parsed: {first_line(error)}; expected aniposelib's TOML") from error
    names = sorted(name for name in content if name.startswith("cam"))
    if len(names) != 2:
        raise InputError(file, f"holds {len(names)} cameras; expected [cam_0] and [cam_1]")
    values = []
    for camera in (_table(file, content, name) for name in names):
        if camera.get("fisheye"):
            raise InputError(file, "fisheye is true; expected pinhole cameras")
        rotation = cv2.Rodrigues(numbers_of(file, camera, "rotation", 3))[0]
        pose = transform(rotation, numbers_of(file, camera, "translation", 3))
        K = numbers_of(file, camera, "matrix", 3, 3)
        lens = numbers_of(file, camera, "distortions")
        values.append(_sized(K, lens, *numbers_of(file, camera, "size", 2)) | {"pose": pose})
    return values


def _sized(K: Array, D: Array, width: float, height: float) -> Matrices:
    return {"K": K, "D": D, "image_width": np.asarray(width), "image_height": np.asarray(height)}


def _pair(cameras: list[Matrices]) -> Matrices:
    return {f"{key}{side}": value for side, camera in enumerate(cameras, start=1) for key, value in camera.items()}


def _translation(file: Path, P: Array) -> Array:
    """The t of a projection [K | K t]."""
    if not (P[0, 0] > 0 and P[1, 1] > 0 and P[2, 2] == 1):
        raise InputError(file, f"projection {np.round(P, 3).tolist()}; expected [K | K t] with positive focal lengths")
    z = P[2, 3]
    x, y = (P[:2, 3] - P[:2, 2] * z) / (P[0, 0], P[1, 1])
    return np.array([x, y, z])


def _check_lens(file: Path, content: Mapping[str, Any]) -> None:
    if (model := str(content.get("distortion_model", "none"))) not in _LENSES:
        raise InputError(file, f"distortion_model {model}; expected one of {', '.join(_LENSES)}")


def _table(file: Path, content: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    table = content[key]
    if not isinstance(table, Mapping):
        raise InputError(file, f"{key} is {str(table)[:60]!r}; expected the entries of a camera")
    return table


def numbers_of(file: Path, content: Mapping[str, Any], key: str, *shape: int) -> Array:
    """The finite numbers of an entry, of any number without a shape: a list, lists of rows, or {rows, cols, data}."""
    value = content.get(key)
    if isinstance(value, Mapping):
        value = value.get("data")
    try:
        items = value if isinstance(value, list) else [value]
        items = [item for row in items for item in (row if isinstance(row, list) else [row])]
        values = np.array([finite(str(item)) for item in items], dtype=float)
        if np.any(np.abs(values) > _LARGEST):
            raise ValueError
        return values.reshape(shape) if shape else values
    except ValueError:
        wanted = f"{'×'.join(map(str, shape))} numbers" if shape else "numbers"
        raise InputError(file, f"{key} is {str(value)[:80]}; expected {wanted}") from None


def parse_yaml(file: Path, text: str, tags: Sequence[str] = ()) -> Any:
    """Return a YAML document as dicts, lists and text, None if it is empty; scalars stay as written (`1e-05`, `1:30`).
    InputError where the text is no YAML, has anchors, aliases, tags but `tags`, repeated keys or several documents, or
    is nested more than 16 levels deep. The message names the line."""
    try:
        _refuse_anchors_tags_and_depth(file, text, tags)
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.reader.ReaderError as error:
        raise _not_yaml(file, error.reason, text.count("\n", 0, error.position)) from error
    except yaml.MarkedYAMLError as error:
        raise _not_yaml(file, error.problem, (error.problem_mark or error.context_mark).line) from error
    return None if node is None else _yaml_content(file, node)


def _refuse_anchors_tags_and_depth(file: Path, text: str, tags: Sequence[str]) -> None:
    """Without aliases no text grows when it is read; without depth the recursion ends."""
    depth = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        is_alias = isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None)
        if is_alias or (getattr(event, "tag", None) or None) not in (None, *tags):
            raise _not_yaml(file, "an anchor, alias or tag", event.start_mark.line)
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _MAX_DEPTH:
            raise _not_yaml(file, f"more than {_MAX_DEPTH} levels", event.start_mark.line)


def _yaml_content(file: Path, node: yaml.Node) -> Any:
    if isinstance(node, yaml.SequenceNode):
        return [_yaml_content(file, item) for item in node.value]
    if not isinstance(node, yaml.MappingNode):
        return str(node.value)
    entries: dict[str, Any] = {}
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode) or key.value in entries:
            reason = f"{key.value} again" if isinstance(key, yaml.ScalarNode) else "a collection as a key"
            raise _not_yaml(file, reason, key.start_mark.line)
        entries[key.value] = _yaml_content(file, value)
    return entries


def _not_yaml(file: Path, reason: str, line: int) -> InputError:
    """The error of a line that is counted from 0."""
    expected = "expected YAML of mappings, lists, numbers and words, each key once"
    return InputError(file, f"cannot be parsed: {reason}; {expected}", line + 1)

"""OpenCV: matrices by the names of its samples, its documentation and its users, in XML, YAML, JSON, .npz or .mat.

| holds | names, with the side behind or before them: 1 2, 0 1, L R, left right |
|---|---|
| camera matrix, (3, 3) | K, M, mtx, cameraMatrix, intrinsic(s), intrinsicMatrix |
| distortion | D, dist, distCoeffs, distortion, distortionCoefficients |
| pose of the left camera in the right one's frame, p_right = R p_left + T | R, T; rotation, translation, … |
| size of the images, px | image_width and image_height, or imageSize |
| projections of the rectified cameras, (3, 4) | P1, P2 |

Case, points and underscores do not matter; in a table its name stands before those of its entries ("left": {"K": …}).
A file without sides is of one camera, the first of these the left one.
"""

import re
from collections.abc import Sequence

import numpy as np

from pps_vision.errors import InputError
from pps_vision.geometry.se3 import transform
from pps_vision.recordings import Lens
from pps_vision.recordings.calibrations import CalibratedCamera, lens_of, rectified_camera, rotation_of
from pps_vision.recordings.documents import Document
from pps_vision.types import Array

IS_LAST = True
FORM = "OpenCV's K1, D1, K2, D2, R, T"
_KINDS = {
    "K": "k|m|cm|mtx|cam(?:era)?mat(?:rix)?|intrinsics?|intrinsicmatrix|matrix",
    "D": "d|dist|(?:dist|distortion)coeff?s?|distortions?|(?:dist|distortion)coefficients?",
    "R": "(?:stereo|extrinsics)?(?:r|rot|rotation|rotmat|rotationmatrix|rotationofcamera2)",
    "T": "(?:stereo|extrinsics)?(?:t|trans|tvec|translation|translationvector|translationofcamera2)",
    "P": "p|projectionmatrix",
    "image_width": "imagewidth",
    "image_height": "imageheight",
    "image_size": "size|imagesize",
    "fisheye": "fisheyemodel",
}
_SIDE = "(?:cam(?:era)?)?(left|right|l|r|[012])"
_NAME = {kind: re.compile(f"(?:{_SIDE})??(?:{names})(?:{_SIDE})?(fe)?") for kind, names in _KINDS.items()}
_OF_ONE_CAMERA = ("K", "D", "P", "image_width", "image_height", "image_size", "fisheye")


def recognises(document: Document) -> bool:
    """Return whether this is the form of a document."""
    return bool({"K1", "K2", "K", "R", "T", "P1"} & _named(_flat(document)).keys())


def read(documents: Sequence[Document]) -> list[CalibratedCamera]:
    """Both cameras, from all files together; InputError if something is missing."""
    entries: dict[str, tuple[Document, str]] = {}
    sides = ["1", "2"]
    for document in map(_flat, documents):
        named = _named(document)
        side = ""
        if "K" in named:
            if not sides:
                raise InputError(document.file, "is one camera more than two; expected a left and a right one")
            side = sides.pop(0)
        for key, name in named.items():
            entries[key + side * (key in _OF_ONE_CAMERA)] = document, name
    where = ", ".join(dict.fromkeys(str(document.file) for document in documents))
    rectified = [_rectified(entries, side) for side in "12"]
    if "K1" not in entries and "K2" not in entries and all(rectified):
        return [camera for camera in rectified if camera]
    for key in ("K1", "K2", "R", "T"):
        if key not in entries:
            raise InputError(where, f"no {key}; expected K1, D1, K2, D2, R and T, or two cameras with their poses")
    document, name = entries["R"]
    pose = transform(rotation_of(document, name), _numbers(entries, "T", 3))
    lens = _lens(entries)
    return [
        CalibratedCamera(
            entries[f"K{side}"][0].file,
            "",
            _numbers(entries, f"K{side}", 3, 3),
            _numbers(entries, f"D{side}") if f"D{side}" in entries else np.zeros(0),
            lens,
            _size(entries, side),
            np.eye(4) if side == "1" else pose,
            rectified=rectified[int(side) - 1],
        )
        for side in "12"
    ]


def _flat(document: Document) -> Document:
    """The entries of a document and, behind the tables' names, of its tables that are no matrices."""
    content = dict(document.content)
    for name, table in document.tables().items():
        if "data" not in table:
            content |= {f"{name}_{key}": value for key, value in table.content.items()}
    return Document(document.file, content)


def _named(document: Document) -> dict[str, str]:
    """The names of a document's entries by what they hold: K1, D1, …; K, D, … without a side."""
    matches = []
    for name in document.content:
        plain = re.sub(r"[^a-z0-9]", "", name.lower())
        for kind, pattern in _NAME.items():
            if match := pattern.fullmatch(plain):
                matches.append((kind, (match[1] or match[2] or ""), match[3], name))
    counts_from_0 = any(side == "0" for _, side, _, _ in matches)
    named = {}
    for kind, side, suffix, name in matches:
        numbers = {"": "", "0": "1", "1": "2" if counts_from_0 else "1", "l": "1", "left": "1"}
        number = numbers.get(side, "2")
        if not (number and kind in "RT"):  # R1 and R2 rectify
            named[kind + number] = name
        if suffix:
            named["fisheye"] = name
    return named


def _numbers(entries: dict[str, tuple[Document, str]], key: str, *shape: int) -> Array:
    """The numbers of an entry; the message of an error calls them by their key."""
    document, name = entries[key]
    return Document(document.file, {key: document.content[name]}).numbers(key, *shape)


def _size(entries: dict[str, tuple[Document, str]], side: str) -> tuple[float, float] | None:
    """Width and height, of this camera or both."""
    for key in (f"image_size{side}", "image_size"):
        if key in entries:
            width, height = _numbers(entries, key, 2)
            return width, height
    sizes = [
        next((_numbers(entries, key, 1)[0] for key in (name + side, name) if key in entries), None)
        for name in ("image_width", "image_height")
    ]
    return None if sizes[0] is None or sizes[1] is None else (float(sizes[0]), float(sizes[1]))


def _rectified(entries: dict[str, tuple[Document, str]], side: str) -> CalibratedCamera | None:
    """The rectified camera of P1 or P2."""
    if f"P{side}" not in entries:
        return None
    P = _numbers(entries, f"P{side}", 3, 4)
    return rectified_camera(entries[f"P{side}"][0].file, "", P, _size(entries, side))


def _lens(entries: dict[str, tuple[Document, str]]) -> Lens | None:
    """The lens model; None for 4 coefficients that do not state it."""
    if "fisheye" in entries:
        document, name = entries["fisheye"]
        return "radtan" if document.word(name).lower() in ("0", "false") else "fisheye"
    for document, _ in entries.values():
        if "distortion_model" in document:
            return lens_of(document, "distortion_model")
    D = [_numbers(entries, key) for key in ("D1", "D2") if key in entries]
    return None if D and any(d.any() for d in D) and all(d.size == 4 for d in D) else "radtan"

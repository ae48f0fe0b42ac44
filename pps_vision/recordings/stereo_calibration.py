"""Stereo calibrations, whatever their form (`pps_vision.recordings.calibrations`), as the cameras of two images."""

import re
from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType

import numpy as np

from pps_vision.errors import InputError
from pps_vision.geometry.camera import Camera
from pps_vision.geometry.se3 import inverse
from pps_vision.recordings import CalibrationOptions, Lens, calibrations
from pps_vision.recordings.calibrations import CalibratedCamera, names_of
from pps_vision.recordings.documents import Document, read_document
from pps_vision.recordings.icub_eyes import LARGEST_SIDE_PX, fit_to_images
from pps_vision.types import Array

_COEFFICIENTS = (5, 8, 12, 14)  # of OpenCV's models of radial and tangential distortion
_DEFAULT = CalibrationOptions()


def read_stereo_calibration(
    paths: Sequence[Path],
    image_size: tuple[int, int] | None,
    options: CalibrationOptions = _DEFAULT,
    images: tuple[Sequence[str], Sequence[str]] = ((), ()),
    right_size: tuple[int, int] | None = None,
) -> tuple[Camera, Camera, Array]:
    """Left camera, right camera and `T_left_right` of a calibration; the root frame is the left camera's.

    InputError if a file cannot be read, or a matrix is missing or invalid, or `options` must say more.

    Args:
        paths: The files of the calibration.
        image_size: Width and height of the images; None: as the calibration states.
        options: Facts that the calibration leaves out.
        images: Paths of the left and the right images, which may hold the names of two of the cameras.
        right_size: Width and height of the right images, where they are of another size.
    """
    if not paths:
        raise InputError("calibration", "no file; expected a calibration")
    documents = [read_document(path) for path in paths]
    names = sorted(module.name for module in iter_modules(calibrations.__path__))
    modules = [import_module(f"{calibrations.__name__}.{name}") for name in names]
    modules.sort(key=lambda module: getattr(module, "IS_LAST", False))
    forms = [_form(document, modules) for document in documents]
    for document, form in zip(documents, forms, strict=True):
        if form is not forms[0]:
            reason = f"is of another form than {paths[0]}, which is {forms[0].FORM}"
            raise InputError(document.file, f"{reason}; expected one form for both cameras")
    cameras: list[CalibratedCamera] = forms[0].read(documents)
    return cameras_of(cameras, image_size, options, images, right_size)


def cameras_of(
    cameras: Sequence[CalibratedCamera],
    image_size: tuple[int, int] | None,
    options: CalibrationOptions = _DEFAULT,
    images: tuple[Sequence[str], Sequence[str]] = ((), ()),
    right_size: tuple[int, int] | None = None,
) -> tuple[Camera, Camera, Array]:
    """The same of cameras that have been read."""
    if not 0 < options.unit_m < float("inf"):
        raise InputError("calibration", f"unit_m {options.unit_m}; expected the positive length of the unit in metres")
    if image_size is None:
        image_size, right_size = (_own_size(camera, options) for camera in _pair(cameras, options.cameras, images))
    sizes = image_size, right_size or image_size
    sized = [camera for camera in cameras if camera.size in sizes]
    chosen = sized if len(sized) == 2 and options.cameras is None else cameras
    named = zip(_pair(chosen, options.cameras, images), sizes, strict=True)
    pair = [_for_images(camera, size, options.rectified) for camera, size in named]
    left, right = (_camera(camera, size, options, side) for camera, size, side in zip(pair, sizes, "12", strict=True))
    T_right_left = pair[1].pose @ inverse(pair[0].pose)
    file = pair[1].file
    if not T_right_left[:3, 3].any():
        raise InputError(file, "T is 0; expected the vector between two cameras")
    T_right_left[:3, 3] *= options.unit_m if options.unit_m != 1 else (pair[1].unit_m or 1.0)
    T_left_right = inverse(T_right_left)
    baseline_m = np.abs(T_left_right[:3, 3]).max()
    if not 1e-5 <= baseline_m <= 1e4:  # products of larger or smaller numbers leave the range of doubles
        raise InputError(file, f"the cameras are {baseline_m:.3g} m apart; expected 0.01 mm to 10 km")
    return left, right, T_left_right


def _own_size(camera: CalibratedCamera, options: CalibrationOptions) -> tuple[int, int]:
    """The size of the images that a camera was calibrated with; InputError where it is not stated."""
    own = camera.rectified if options.rectified and camera.rectified else camera
    if own.size is None:
        raise InputError(camera.file, "does not state the size of the images; expected --size WIDTH HEIGHT")
    return round(own.size[0]), round(own.size[1])


def _form(document: Document, modules: Sequence[ModuleType]) -> ModuleType:
    """The form of a document."""
    for module in modules:
        if module.recognises(document):
            return module
    keys = ", ".join(list(document.content)[:8])
    forms = ", ".join(module.FORM for module in modules)
    raise InputError(document.file, f"holds no calibration, but {keys[:80] or 'nothing'}; expected one of: {forms}")


def _pair(
    cameras: Sequence[CalibratedCamera], names: tuple[str, str] | None, images: tuple[Sequence[str], Sequence[str]]
) -> list[CalibratedCamera]:
    """The left and the right camera: by name, by the paths of the images, or the only two in their order."""
    if names is not None:
        by_name = {camera.other_name: camera for camera in cameras} | {camera.name: camera for camera in cameras}
        if missing := [name for name in names if name not in by_name]:
            expected = f"two of {names_of(cameras)}" if any(by_name) else "no --cameras: it holds two, without names"
            raise InputError(cameras[0].file, f"no camera {missing[0]}; expected {expected}")
        return [by_name[name] for name in names]
    in_paths = [_named_in(paths, cameras) for paths in images]
    if in_paths[0] and in_paths[1] and in_paths[0] is not in_paths[1]:
        return [camera for camera in in_paths if camera]
    if len(cameras) == 2:
        return list(cameras)
    if len(cameras) < 2:
        raise InputError(cameras[0].file, "holds 1 camera; expected two, or two files")
    reason = f"holds {len(cameras)} cameras, {names_of(cameras)}; two are used"
    example = f"{cameras[0].name} {cameras[1].name}"
    raise InputError(cameras[0].file, f"{reason}; expected --cameras LEFT RIGHT, such as --cameras {example}")


def _named_in(paths: Sequence[str], cameras: Sequence[CalibratedCamera]) -> CalibratedCamera | None:
    """The only camera whose name is a word of the first path, of its last part that holds one's."""
    for part in Path(paths[0]).absolute().parts[::-1] if paths else ():
        words = "|".join(re.escape(name) for camera in cameras for name in (camera.name, camera.other_name) if name)
        found = set(re.findall(rf"(?<![^\W_])(?:{words})(?![^\W_])", part)) if words else set()
        named = [camera for camera in cameras if {camera.name, camera.other_name} & found]
        if named:
            return named[0] if len(named) == 1 else None
    return None


def _for_images(camera: CalibratedCamera, image_size: tuple[int, int], rectified: bool) -> CalibratedCamera:
    """The camera, or that of rectified images, where these are or only its size is theirs."""
    if rectified and camera.rectified is None:
        raise InputError(camera.file, "holds no projection; expected P1 and P2 with --rectified")
    if camera.rectified is None or not (rectified or image_size == camera.rectified.size != camera.size):
        return camera
    return camera.rectified


def _camera(camera: CalibratedCamera, image_size: tuple[int, int], options: CalibrationOptions, side: str) -> Camera:
    """One camera, for the images."""
    file, K = camera.file, camera.K
    fx, fy, cx, cy = (float(value) for value in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
    if not (fx > 0 and fy > 0 and np.allclose(K, np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), atol=1e-6 * fx)):
        entry = f"K{side} is {np.round(K, 3).tolist()}"
        raise InputError(file, f"{entry}; expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx, fy > 0")
    width, height = camera.size or image_size
    if not all(1 <= size <= LARGEST_SIDE_PX and float(size).is_integer() for size in (width, height)):
        entry = f"image_width {width}, image_height {height}"
        raise InputError(file, f"{entry}; expected whole numbers of pixels, at most {LARGEST_SIDE_PX}")
    lens = _lens(camera, options.lens, side)
    distortion = _distortion(camera, lens, side)
    calibrated = Camera(int(width), int(height), fx, fy, cx, cy, distortion, lens == "fisheye")
    return _fitted(calibrated, image_size, options, file)


def _lens(camera: CalibratedCamera, given: Lens | None, side: str) -> Lens:
    """The model of the lens, as stated or given."""
    if camera.lens and given not in (None, camera.lens):
        raise InputError(camera.file, f"its lens model is {camera.lens}; expected no --lens {given}")
    if (lens := camera.lens or given) is None:
        reason = f"D{side} holds 4 coefficients of a lens model that is not stated"
        expected = "--lens radtan (of cv2.calibrateCamera or stereoCalibrate) or --lens fisheye (of cv2.fisheye)"
        raise InputError(camera.file, f"{reason}; expected {expected}")
    return lens


def _distortion(camera: CalibratedCamera, lens: Lens, side: str) -> tuple[float, ...]:
    """As many coefficients as OpenCV's smallest model that holds them."""
    D = np.trim_zeros(camera.D, "b").tolist()
    lengths = (4,) if lens == "fisheye" else _COEFFICIENTS
    if len(D) > lengths[-1]:
        raise InputError(
            camera.file, f"D{side} has {len(D)} coefficients; expected {lengths[-1]} or fewer of a {lens} lens"
        )
    length = next(length for length in lengths if length >= len(D))
    return (*D, *[0.0] * (length - len(D)))


def _fitted(camera: Camera, image_size: tuple[int, int], options: CalibrationOptions, file: Path) -> Camera:
    """The camera for images of this size; InputError where it must be said how they come from those of the
    calibration."""
    width, height = image_size
    reason = f"calibrated for {camera.width}×{camera.height} pixels, images are {width}×{height}"
    if (camera.width, camera.height) == image_size and any(options.crop or ()):
        raise InputError(file, f"{reason}; expected no --crop, or the calibration of the whole images")
    if (camera.width, camera.height) == image_size or (options.scaled and not options.crop):
        return fit_to_images(camera, image_size, file)
    if options.scaled:
        raise InputError("calibration", "crop and scaled; expected one of them")
    if options.crop:
        x, y = options.crop
        if not (0 <= x <= camera.width - width and 0 <= y <= camera.height - height):
            raise InputError(file, f"{reason}; expected --crop X Y of a part of the former")
        cropped = replace(camera, width=width, height=height, cx=camera.cx - x, cy=camera.cy - y)
        return fit_to_images(cropped, image_size, file)
    ways = []
    if abs(width * camera.height - height * camera.width) <= camera.width:  # a pixel of rounding
        ways.append("--scaled (the whole image at another resolution)")
    if width <= camera.width and height <= camera.height:
        ways.append("--crop X Y (a part of the image; the pixel there that is the top-left one here)")
    raise InputError(file, f"{reason}; expected {' or '.join(ways) or 'images of the same camera'}")

"""Finds the ports of a yarpdatadumper recording by the names of their folders."""

from pathlib import Path

from pps_vision.errors import InputError

_JOINTS_AND_SKIN = {
    "torso": "torso",
    "head": "head",
    "leftarm": "left_arm",
    "rightarm": "right_arm",
    "skin": "skin",
}
_IMAGE_SUFFIXES = (".ppm", ".pgm", ".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")


def find_ports(folder: Path) -> dict[str, Path]:
    """The data.log of every port: "left" and "right" (images), torso, head, left_arm, right_arm, skin.

    Joints and skin lie in a folder called so (`rightArm`, `right_arm/state:o`), images below one
    whose name holds left or right.  InputError if two logs claim one port.
    """
    ports: dict[str, Path] = {}
    logs = sorted(folder.rglob("data.log"))
    for log in logs:
        port = _port(log.parent.relative_to(folder), log)
        if port in ports:
            raise InputError(log, f"a second log for {port}; expected one, and {ports[port]} is there")
        if port is not None:
            ports[port] = log
    for log in logs:
        if log.parent.name in ("left", "right") and not _first_line(log).strip():
            ports.setdefault(log.parent.name, log)  # it names no image, which its reader reports
    return ports


def _port(place: Path, log: Path) -> str | None:
    """Which port a log belongs to, None if to one that is not read here."""
    if _holds_images(log):
        name = place.as_posix().lower()
        side = max(("left", "right"), key=name.rfind)
        return side if side in name else None
    parts = [part.lower().replace("_", "") for part in place.parts]
    return next((_JOINTS_AND_SKIN[part] for part in parts if part in _JOINTS_AND_SKIN), None)


def _holds_images(log: Path) -> bool:
    """By the type info.log states, or else by what the first row names."""
    info = log.with_name("info.log")
    kind = _first_line(info) if info.is_file() else ""
    if kind.startswith("Type:"):
        return kind.removeprefix("Type:").strip().startswith("Image")
    return any(word.lower().endswith(_IMAGE_SUFFIXES) for word in _first_line(log).split())


def _first_line(file: Path) -> str:
    try:
        with file.open(errors="replace") as stream:
            return stream.readline(10_000)
    except OSError:  # whoever reads the whole file says so
        return ""

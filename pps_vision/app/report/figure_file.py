"""Figures as files."""

from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image

from pps_vision.errors import InputError


def save(figure: Figure, file: Path, colors: int | None = None) -> None:
    """Write a figure in the format of the file's suffix; with `colors` as a .png with a palette of this size.

    Raises:
        InputError: The format is unknown.
    """
    formats = figure.canvas.get_supported_filetypes()
    if file.suffix[1:].lower() not in formats:
        expected = ", ".join(f".{name}" for name in formats)
        raise InputError(file.name, f"has the suffix {file.suffix!r}; expected one of {expected}")
    figure.savefig(file, dpi=130)
    if colors is not None:
        with Image.open(file) as image:
            image.convert("RGB").quantize(colors, dither=Image.Dither.NONE).save(file, "PNG", optimize=True)

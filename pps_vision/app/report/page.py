"""Reports: self-contained pages, with what matters most on top, and the figures in them."""

import base64
import html
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from PIL import Image

from pps_vision.errors import InputError
from pps_vision.recordings import REPORT
from pps_vision.recordings.atomic_write import whole_file
from pps_vision.types import Array

_STYLE = """
body{font:16px/1.5 system-ui,sans-serif;color:#222;max-width:70rem;margin:2rem auto;padding:0 1rem}
h1{font-size:1.7rem;margin-bottom:.2rem} h2{font-size:1.2rem;margin-top:2.2rem}
video,img{max-width:100%;height:auto} video{width:100%;background:#111;border-radius:6px}
table{border-collapse:collapse;margin:1rem 0;font-variant-numeric:tabular-nums}
th,td{padding:.3rem .8rem;border-bottom:1px solid #ddd;text-align:right} th:first-child,td:first-child{text-align:left}
p.lead{color:#555;margin-top:0} pre{background:#f4f4f4;padding:.6rem;white-space:pre-wrap;overflow-wrap:anywhere}
ul.warnings{background:#fff3dc;border-left:4px solid #e0a020;padding:.6rem 1rem .6rem 2rem}
"""


Section = tuple[str, str, str]
"""A heading, a text, and an HTML fragment below it."""


def image(figure: Figure) -> str:
    """A figure as an HTML fragment."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return f'<img alt="" src="data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}">'


def video(path: Path) -> str:
    """An .mp4 file as an HTML fragment."""
    data = base64.b64encode(path.read_bytes()).decode()
    return f'<video controls autoplay muted loop src="data:video/mp4;base64,{data}"></video>'


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table as an HTML fragment; cells are text."""
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in header)
    lines = ("".join(f"<td>{html.escape(cell)}</td>" for cell in row) for row in rows)
    return f"<table><tr>{head}</tr>" + "".join(f"<tr>{line}</tr>" for line in lines) + "</table>"


def write_page(folder: Path, title: str, lead: str, opening: str, sections: Sequence[Section]) -> None:
    """Write report.html; nothing in it refers to another file but links of `opening` and `sections`."""
    parts = "".join(f"<h2>{html.escape(name)}</h2><p>{html.escape(text)}</p>{body}" for name, text, body in sections)
    page = (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f"<style>{_STYLE}</style><h1>{html.escape(title)}</h1>"
        f'<p class="lead">{html.escape(lead)}</p>{opening}{parts}</html>'
    )
    with whole_file(folder / REPORT) as partial:
        partial.write_text(page, encoding="utf-8", errors="backslashreplace")


def save(figure: Figure, file: Path, colors: int | None = None) -> None:
    """Write a figure in the format of the file's suffix, InputError if it is unknown; with `colors` as a .png with a
    palette of this size."""
    formats = figure.canvas.get_supported_filetypes()
    if file.suffix[1:].lower() not in formats:
        expected = ", ".join(f".{name}" for name in formats)
        raise InputError(file.name, f"has the suffix {file.suffix!r}; expected one of {expected}")
    figure.savefig(file, dpi=130)
    if colors is not None:
        with Image.open(file) as image:
            image.convert("RGB").quantize(colors, dither=Image.Dither.NONE).save(file, "PNG", optimize=True)


def shade(axis: Axes, t: Array, where: ArrayLike, color: str, alpha: float = 0.2) -> None:
    """Colour the times (T,) at which `where` (T,) holds, each half the way to its neighbours."""
    edges = np.concatenate([t[:1], 0.5 * (t[1:] + t[:-1]), t[-1:]])
    over, holds = axis.get_xaxis_transform(), np.repeat(np.asarray(where, bool), 2)
    axis.fill_between(np.repeat(edges, 2)[1:-1], 0, 1, where=holds, transform=over, color=color, alpha=alpha, lw=0)

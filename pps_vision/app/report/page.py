"""Reports: self-contained pages, with what matters most on top, and the figures in them."""

import base64
import hashlib
import io
import os
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from urllib.parse import quote

import numpy as np
from jinja2 import Environment, StrictUndefined, Template
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

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
dl.answers{display:grid;grid-template-columns:max-content 1fr;gap:.4rem 1.2rem;margin:1rem 0}
dt{font-weight:600} dd{margin:0}
ul.warnings{margin:0;background:#fff3dc;border-left:4px solid #e0a020;padding:.6rem 1rem .6rem 2rem}
div.wide{overflow-x:auto}
@media (max-width:45rem){
dl.answers{grid-template-columns:1fr} dl.answers dt{margin-top:.5rem} div.wide img{max-width:none;width:44rem}}
"""
_PAGE = """
<!doctype html><html lang="en"><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{{ policy }}">
<meta name="viewport" content="width=device-width">
<title>{{ title }}</title><style>{{ style }}</style>
<h1>{{ title }}</h1><p class="lead">{{ lead }}</p>{{ opening }}
{% for name, text, body in sections %}<h2>{{ name }}</h2><p>{{ text }}</p>{{ body }}{% endfor %}
</html>"""
_POLICY = (
    "default-src 'none'; img-src data:; media-src data:; style-src 'unsafe-inline'; script-src 'sha256-{digest}'; "
    "base-uri 'none'; form-action 'none'"
)
_TABLE = """
<div class="wide"><table><tr>{% for cell in header %}<th>{{ cell }}</th>{% endfor %}</tr>
{% for row in rows %}<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>{% endfor %}</table></div>"""
_TEMPLATES = Environment(autoescape=True, undefined=StrictUndefined)

Section = tuple[str, str, str]  # a heading, a text, and an HTML fragment (`Markup`) below it


def fragment(template: str, **values: object) -> Markup:
    """HTML from a Jinja2 template; values are escaped unless they are fragments."""
    return Markup(_compiled(template).render(values))


@cache
def _compiled(template: str) -> Template:
    return _TEMPLATES.from_string(template)


def picture(content: bytes, kind: str, name: str = "") -> Markup:
    """The content of an image file of a kind (png, jpeg) as an HTML fragment, with a name."""
    data = base64.b64encode(content).decode()
    return fragment(
        '<img alt="{{ name }}" src="data:image/{{ kind }};base64,{{ data }}">', name=name, kind=kind, data=data
    )


def image(figure: Figure) -> Markup:
    """A figure as an HTML fragment; on a narrow screen it is moved sideways."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return fragment('<div class="wide">{{ image }}</div>', image=picture(buffer.getvalue(), "png"))


def video(path: Path) -> Markup:
    """An .mp4 file as an HTML fragment."""
    data = base64.b64encode(path.read_bytes()).decode()
    return fragment('<video controls autoplay muted loop src="data:video/mp4;base64,{{ data }}"></video>', data=data)


def table(header: Sequence[str], rows: Iterable[Iterable[str]]) -> Markup:
    """A table as an HTML fragment; cells are text or fragments."""
    return fragment(_TABLE, header=header, rows=rows)


def link(text: str, *path: str) -> Markup:
    """A link to a file whose path from the page's folder consists of these names."""
    address = "/".join(quote(os.fsencode(name), safe="") for name in path)
    return fragment('<a href="{{ address }}">{{ text }}</a>', address=address, text=text)


def write_page(
    folder: Path, title: str, lead: str, opening: str, sections: Sequence[Section], script: str = ""
) -> None:
    """Write report.html; nothing in it refers to another file but links, and no script runs but `script`, which a
    fragment of `sections` holds."""
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    values = {"style": Markup(_STYLE), "title": title, "lead": lead, "opening": opening, "sections": sections}
    page = fragment(_PAGE, policy=_POLICY.format(digest=digest), **values)
    with whole_file(folder / REPORT) as partial:
        partial.write_text(page, encoding="utf-8", errors="backslashreplace")


def save(figure: Figure, file: Path) -> None:
    """Write a figure in the format of the file's suffix, InputError if it is unknown."""
    formats = figure.canvas.get_supported_filetypes()
    if file.suffix[1:].lower() not in formats:
        expected = ", ".join(f".{name}" for name in formats)
        raise InputError(file.name, f"has the suffix {file.suffix!r}; expected one of {expected}")
    figure.savefig(file, dpi=130)


def shade(axis: Axes, t: Array, where: ArrayLike, color: str, alpha: float = 0.2) -> None:
    """Colour the times (T,) at which `where` (T,) holds, each half the way to its neighbours."""
    edges = np.concatenate([t[:1], 0.5 * (t[1:] + t[:-1]), t[-1:]])
    over, holds = axis.get_xaxis_transform(), np.repeat(np.asarray(where, bool), 2)
    axis.fill_between(np.repeat(edges, 2)[1:-1], 0, 1, where=holds, transform=over, color=color, alpha=alpha, lw=0)

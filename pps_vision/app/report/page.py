"""Reports: self-contained pages, with what matters most on top."""

import base64
import html
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

_STYLE = """
body{font:16px/1.5 system-ui,sans-serif;color:#222;max-width:70rem;margin:2rem auto;padding:0 1rem}
h1{font-size:1.7rem;margin-bottom:.2rem} h2{font-size:1.2rem;margin-top:2.2rem}
video,img{max-width:100%;height:auto} video{width:100%;background:#111;border-radius:6px}
table{border-collapse:collapse;margin:1rem 0;font-variant-numeric:tabular-nums}
th,td{padding:.3rem .8rem;border-bottom:1px solid #ddd;text-align:right} th:first-child,td:first-child{text-align:left}
p.lead{color:#555;margin-top:0} pre{background:#f4f4f4;padding:.6rem;white-space:pre-wrap;overflow-wrap:anywhere}
ul.warnings{background:#fff3dc;border-left:4px solid #e0a020;padding:.6rem 1rem .6rem 2rem}
"""


@dataclass(frozen=True)
class Section:
    """A heading, a text, and an HTML fragment below it."""

    title: str
    text: str
    body: str


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


def page(title: str, lead: str, opening: str, sections: Sequence[Section]) -> str:
    """The whole page; nothing in it refers to another file."""
    parts = "".join(f"<h2>{html.escape(s.title)}</h2><p>{html.escape(s.text)}</p>{s.body}" for s in sections)
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f"<style>{_STYLE}</style><h1>{html.escape(title)}</h1>"
        f'<p class="lead">{html.escape(lead)}</p>{opening}{parts}</html>'
    )

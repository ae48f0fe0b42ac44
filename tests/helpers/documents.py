"""The pages of the documentation, and their commands."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = [*sorted((ROOT / "docs").rglob("*.md")), *(ROOT / name for name in ("README.md", "CONTRIBUTING.md"))]


def blocks(page: Path) -> list[tuple[str, str, str]]:
    """Language, title and text of the code blocks of a page."""
    matches = re.findall(r"^```(\w+)(?: title=\"(.+)\")?\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL)
    return [(language, title, text) for language, title, text in matches]


def typed(page: Path) -> list[str]:
    """The lines of a page to type into a shell, without their comments: of blocks `console` and `sh`, and indented."""
    lines = [line for language, _, text in blocks(page) if language in ("console", "sh") for line in text.splitlines()]
    without = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    lines += re.findall(r"^ {4}((?:pps-vision|make|pip) .*)$", without, re.MULTILINE)
    return [re.split(r" {2,}#", line)[0].strip() for line in lines]

"""Parts of a long run that are kept until all are finished, so that an interrupted run goes on where it stopped."""

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from tempfile import gettempdir
from typing import Any

from pps_vision.experiments.study import Study
from pps_vision.recordings.outputs import whole_file, write_json


def part(file: Path, do: Callable[[], Any]) -> Any:
    """Return what a file holds; where there is none, do it first and write it down as JSON."""
    if not file.exists():
        found = do()
        with whole_file(file) as partial_file:
            write_json(partial_file, found)
    return json.loads(file.read_text())


def kept_folder(study: Study) -> Path:
    """Return the folder, among the system's temporary ones, of a study's parameters and of all code."""
    root, digest = Path(__file__).parents[2], hashlib.sha256(repr(study).encode())
    for package in ("pps_vision", "rendering", "tracking", "learning", "control"):
        for file in sorted((root / package).rglob("*.py")):
            digest.update(file.read_bytes())
    name = type(study).__name__.lower()
    return Path(gettempdir()) / f"pps-vision-{name}-{digest.hexdigest()[:16]}"

"""Run the tasks of a study in parallel processes, and go on where an interrupted run stopped."""

import json
import shutil
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TypeVar

from pps_vision.app.encounters.suite import Rows, map_tasks
from pps_vision.recordings.atomic_write import plain, whole_file

AnyTask = TypeVar("AnyTask")


def run_tasks(
    folder: Path, rows_of: Callable[[AnyTask, Path], Rows], tasks: Mapping[str, AnyTask], workers: int
) -> Rows:
    """Return the rows of all tasks, by `rows_of(task, folder)` in `workers` processes; with 1 all run in this one.

    Finished tasks' rows are kept in `folder` until all are finished.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"{name}.json" for name in tasks]
    rows = map_tasks(partial(_stored, rows_of), workers, list(tasks.values()), files)
    shutil.rmtree(folder)
    return rows


def _stored(rows_of: Callable[[AnyTask, Path], Rows], task: AnyTask, file: Path) -> Rows:
    """Rows of a task, read from `file` if it exists."""
    if not file.exists():
        rows = rows_of(task, file.parent)
        with whole_file(file) as partial_file:
            partial_file.write_text(json.dumps(plain(rows)))
    stored: Rows = json.loads(file.read_text())
    return stored

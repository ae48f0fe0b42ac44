"""Pools of worker processes that end with the process that made them."""

import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context, parent_process
from threading import Thread


def worker_pool(workers: int, max_tasks_per_child: int | None = None) -> ProcessPoolExecutor:
    """A pool of spawned processes (OpenGL and threads survive no fork) that end when this one does, also if killed."""
    spawn = get_context("spawn")
    return ProcessPoolExecutor(workers, spawn, initializer=_end_with_parent, max_tasks_per_child=max_tasks_per_child)


def _end_with_parent() -> None:
    Thread(target=_wait_for_parent, daemon=True).start()


def _wait_for_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)

"""Pools of worker processes that end with the process that made them."""

import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context, parent_process
from threading import Thread


def worker_pool(workers: int, max_tasks_per_child: int | None = None) -> ProcessPoolExecutor:
    """A pool whose processes are spawned (OpenGL and threads do not survive a fork) and end when this one does, also
    when it is killed."""
    return ProcessPoolExecutor(
        workers, get_context("spawn"), initializer=_end_with_parent, max_tasks_per_child=max_tasks_per_child
    )


def _end_with_parent() -> None:
    Thread(target=_wait_for_parent, daemon=True).start()


def _wait_for_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)

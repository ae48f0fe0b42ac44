"""Pools of worker processes that end with the process that made them."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from multiprocessing import get_context, parent_process
from threading import Thread
from typing import Any, TypeVar

Result = TypeVar("Result")


def worker_pool(workers: int, max_tasks_per_child: int | None = None) -> ProcessPoolExecutor:
    """A pool of spawned processes (OpenGL and threads survive no fork) that end when this one does, also if killed."""
    spawn = get_context("spawn")
    return ProcessPoolExecutor(workers, spawn, initializer=_end_with_parent, max_tasks_per_child=max_tasks_per_child)


def mapped(function: Callable[..., Result], workers: int, *arguments: Sequence[Any]) -> Iterator[Result]:
    """Results of a function of one of each of the `arguments`, in their order, in `workers` processes (1: this one)."""
    with worker_pool(workers) if workers > 1 else nullcontext() as pool:
        yield from (pool.map if pool else map)(function, *arguments)


def _end_with_parent() -> None:
    Thread(target=_wait_for_parent, daemon=True).start()


def _wait_for_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)

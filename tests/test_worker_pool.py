"""Workers end with the process that made them."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

PARENT = """
from pps_vision.worker_pool import worker_pool
from tests.helpers.sleeping import sleep

if __name__ == "__main__":
    with worker_pool(2) as pool:
        pool.submit(sleep, "{0}/1")
        pool.submit(sleep, "{0}/2")
"""


def test_workers_of_a_killed_process_end(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(PARENT.format(tmp_path))
    env = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    parent = subprocess.Popen([sys.executable, str(script)], env=env)
    files = [tmp_path / "1", tmp_path / "2"]
    try:
        workers = [int(_written(file)) for file in files]
        assert len({*workers, parent.pid}) == 3
        assert all(_runs(pid) for pid in workers)
    finally:
        parent.send_signal(signal.SIGKILL)
        parent.wait()
    for _ in range(200):
        if not any(_runs(pid) for pid in workers):
            return
        time.sleep(0.1)
    raise AssertionError("a worker still runs")


def _written(file: Path) -> str:
    for _ in range(600):
        if file.exists() and (text := file.read_text()):
            return text
        time.sleep(0.1)
    raise AssertionError(f"{file} is not written")


def _runs(pid: int) -> bool:
    """Whether a process runs; one that has ended and is not yet waited for does not."""
    stat = Path(f"/proc/{pid}/stat")
    return stat.exists() and stat.read_text().rpartition(")")[2].split()[0] != "Z"

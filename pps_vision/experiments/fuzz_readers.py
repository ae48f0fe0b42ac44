"""Mutated files for every reader: each must be read or refused by InputError or OSError, in bounded time and memory.

Run as a program (`python -m pps_vision.experiments.fuzz_readers READER SEED FIRST N`) it reads N mutants in its own
process and prints JSON for each; `fuzz` starts such processes, so that a crash or a hang of a library costs one mutant.
"""

import json
import resource
import signal
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from threading import Timer
from types import FrameType
from typing import Any

import numpy as np

from pps_vision.errors import InputError
from pps_vision.experiments.sound_inputs import READERS, Reader

PROGRAM = (sys.executable, "-m", "pps_vision.experiments.fuzz_readers")
MOST_SECONDS = 10.0  # for one mutant, whose sound form takes milliseconds
_MOST_SECONDS_TO_START = 300.0  # of imports, and of the sound form
MOST_BYTES = 800 * 2**20  # of resident memory that one mutant may add; an image of 2^25 pixels takes 100 MB

_TOKENS = (
    *(b"nan", b"inf", b"-1", b"0", b"1e300", b"1e-300", b"1e999", b"9" * 40, b"1,5", b"1_000", b"\x00"),
    *(b"\xef\xbb\xbf", b"\xff\xfe", *b"( ) [ ] { } <a> </".split(), b'"', b"\n", b"\r\n", b"\t", b",", b":", b"#"),
    *(b"//", b"- ", b"%", b"&amp;", b"../", b"/etc/passwd", "é".encode(), b"\xf0\x9f\x92\xa5", b"[l_hand]\n", b"(" * 8),
)


@dataclass(frozen=True)
class Outcome:
    """How the mutants of one reader ended."""

    read: int
    refused: int
    faults: tuple[str, ...]
    """The others: number of the mutant and what happened."""


def mutate(content: bytes, rng: np.random.Generator) -> bytes:
    """Return the content with one to four changes: bits, spans, lines, numbers, tokens, or its end."""
    for _ in range(int(rng.choice([1, 1, 1, 2, 3, 4]))):
        a, b = sorted(rng.integers(0, len(content) + 1, 2).tolist())
        b = min(b, a + int(rng.integers(1, 64)))
        token = _TOKENS[int(rng.integers(len(_TOKENS)))]
        lines = content.split(b"\n")
        i, j = rng.integers(len(lines), size=2).tolist()
        way = int(rng.integers(10))
        if way == 0 and content:
            at = min(a, len(content) - 1)
            content = content[:at] + bytes([content[at] ^ 1 << int(rng.integers(8))]) + content[at + 1 :]
        elif way == 1:
            content = content[:a] + content[b:]
        elif way == 2:
            content = content[:b] + content[a:b] * int(rng.integers(1, 40)) + content[b:]
        elif way == 3:
            content = content[:a] + rng.bytes(int(rng.integers(1, 16))) + content[b:]
        elif way == 4:
            content = content[:a] + token + content[a:]
        elif way == 5:
            content = content[:a] + token * int(rng.integers(1, 4000)) + content[a:]
        elif way == 6:
            content = content[:a]
        elif way == 7:
            lines[i], lines[j] = lines[j], lines[i]
            content = b"\n".join(lines)
        elif way == 8:
            content = b"\n".join([*lines[:i], *lines[j : j + 3], *lines[i:]])
        else:
            words = lines[i].split(b" ")
            words[int(rng.integers(len(words)))] = token
            lines[i] = b" ".join(words)
            content = b"\n".join(lines)
    return content


def mutate_archive(content: bytes, rng: np.random.Generator) -> bytes:
    """Return an .npz file with changed arrays in it; a third of the time the bytes of the file are changed instead."""
    if rng.random() < 1 / 3:
        return mutate(content, rng)
    with np.load(BytesIO(content)) as file:
        arrays: dict[str, Any] = {name: file[name] for name in file.files}
    for _ in range(int(rng.integers(1, 3))):
        name = sorted(arrays)[int(rng.integers(len(arrays)))]
        array, way = arrays[name], int(rng.integers(8))
        if way == 0 and len(arrays) > 1:
            del arrays[name]
        elif way == 1:
            arrays[name] = array.ravel()
        elif way == 2:
            arrays[name] = array[..., None] if rng.random() < 0.5 else array[:0] if array.ndim else array[None]
        elif way == 3:
            kinds = ("U3", "S2") if array.dtype.kind in "USc" else ("U3", "c16", "f2", "u1", "?", "S2")
            with np.errstate(all="ignore"):
                arrays[name] = array.astype(kinds[int(rng.integers(len(kinds)))])
        elif array.dtype.kind in "iuf" and array.size:
            changed = array.astype(float if way < 6 else array.dtype).ravel()
            with np.errstate(all="ignore"):
                value = rng.choice([np.nan, np.inf, -np.inf, -1, 0, 1e300, 1e-300, 2.0**63, 0.5, 1e9])
                if changed.dtype.kind != "f":
                    value = int(rng.integers(-(2**31), 2**31)) % (np.iinfo(changed.dtype).max + 1)
                changed[rng.random(changed.size) < rng.choice([0.02, 0.5, 1.0])] = value
            arrays[name] = changed.reshape(array.shape)
        else:
            arrays[name] = np.array("x" * int(rng.integers(0, 300)))
    out = BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def try_mutants(reader: Reader, seed: int, numbers: range) -> Iterator[tuple[int, str]]:
    """Yield the number of each mutant with "start", and then with how it ended: read, refused, or what went wrong.

    Mutant k of a seed is the same in every run.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = list(reader.write(folder))
        sound = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
        reader.read(folder)  # sound input must be read; also imports and compiles, whose time and memory do not count
        for k in numbers:
            yield k, "start"
            rng = np.random.default_rng([seed, k])
            file = files[int(rng.integers(len(files)))]
            change = mutate_archive if file.suffix == ".npz" else mutate
            expected = {**sound, file: change(sound[file], rng)}
            file.write_bytes(expected[file])
            yield k, _try(reader, folder, expected)
            file.write_bytes(sound[file])


def _try(reader: Reader, folder: Path, expected: Mapping[Path, bytes]) -> str:
    """Read one mutant."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    signal.signal(signal.SIGALRM, _stop)
    signal.setitimer(signal.ITIMER_REAL, MOST_SECONDS)
    try:
        reader.read(folder)
        ended = "read"
    except (InputError, OSError) as error:
        ended = "refused" if not isinstance(error, TimeoutError) else f"over {MOST_SECONDS} s"
    except Exception as error:  # any other is a fault, whatever it is
        ended = f"{type(error).__name__}: {error}"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    added = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    if added > MOST_BYTES:
        return f"takes {added // 2**20} MB"
    if {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} != expected:
        return "files of the input were changed"
    return ended


def _stop(signum: int, frame: FrameType | None) -> None:
    raise TimeoutError


def fuzz(name: str, seed: int, n: int, program: Sequence[str] = PROGRAM) -> Outcome:
    """Read `n` mutants with the reader of this name, in a process that is started anew after a crash or a hang."""
    ends: dict[int, str] = {}
    k = 0
    while k < n:
        command = [*program, name, str(seed), str(k), str(n - k)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as worker:
            watchdog = Timer(_MOST_SECONDS_TO_START, worker.kill)
            watchdog.start()
            for line in worker.stdout or ():
                watchdog.cancel()
                k, ended = json.loads(line)
                ends[k] = ended
                watchdog = Timer(3 * MOST_SECONDS, worker.kill)
                watchdog.start()
            watchdog.cancel()
        if worker.returncode == 0 and len(ends) == n and "start" not in ends.values():
            break
        if k not in ends:
            raise RuntimeError(f"{name}: ended by {worker.returncode} before its first mutant")
        if ends[k] == "start":
            ends[k] = f"ended the process by {worker.returncode}"
        k += 1
    count = list(ends.values()).count
    faults = tuple(f"{name} {k}: {ended}" for k, ended in ends.items() if ended not in ("read", "refused"))
    return Outcome(count("read"), count("refused"), faults)


def main(name: str, seed: str, first: str, n: str) -> None:
    """Print how each mutant ended."""
    warnings.simplefilter("error", RuntimeWarning)  # a user would see NumPy's
    for k, ended in try_mutants(READERS[name], int(seed), range(int(first), int(first) + int(n))):
        print(json.dumps([k, ended]), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])

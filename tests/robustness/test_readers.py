"""Mutated files for every reader: each is read or refused by InputError or OSError, in bounded time and memory."""

import resource
import signal
from collections.abc import Iterator, Mapping
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType
from typing import Any

import numpy as np
import pytest
from data import SEED
from sound_inputs import READERS, Reader

from pps_vision.errors import InputError

MAX_SECONDS = 5.0
"""Processor time for one mutant, and a twelfth of the time on the clock; the sound input takes milliseconds."""
TIMERS = (signal.ITIMER_PROF, signal.SIGPROF, 1), (signal.ITIMER_REAL, signal.SIGALRM, 12)
MAX_BYTES = 800 * 2**20
"""Resident memory that one mutant may add; an image of 2²⁵ pixels takes 100 MB."""
TOKENS = (
    *(b"nan", b"inf", b"-1", b"0", b"1e300", b"1e-300", b"1e999", b"9" * 40, b"1,5", b"1_000", b"\x00"),
    *(b"\xef\xbb\xbf", b"\xff\xfe", *b"( ) [ ] { } <a> </".split(), b'"', b"\n", b"\r\n", b"\t", b",", b":", b"#"),
    *(b"//", b"- ", b"%", b"&amp;", b"../", b"/etc/passwd", "é".encode(), b"\xf0\x9f\x92\xa5", b"[l_hand]\n", b"(" * 8),
)
BROKE_A_READER = [
    ("manifest", b"name,left\nfirst,l.mp4\rsecond,r.mp4\n"),
    ("mesh_obj", b"v 0 0\nv 1 0\nv 0 1\nv 1 1\nf 1 2 3\nf 2 3 4\n"),
    ("mesh_obj", b"v 0\nv 1\nv 2\nf 1 2 3\n"),
    ("mesh_obj", b"v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 2 3\nf 1 3 2\nf 2 1 4\nf 2 4 1\n"),
]


def mutate(content: bytes, rng: np.random.Generator) -> bytes:
    """Return the content with one to four changes: bits, spans, lines, numbers, tokens, or its end."""
    for _ in range(int(rng.choice([1, 1, 1, 2, 3, 4]))):
        start, end = sorted(rng.integers(0, len(content) + 1, 2).tolist())
        end = min(end, start + int(rng.integers(1, 64)))
        head = content[:start]
        span = content[start:end]
        tail = content[end:]
        token = TOKENS[int(rng.integers(len(TOKENS)))]
        lines = content.split(b"\n")
        i, j = rng.integers(len(lines), size=2).tolist()
        words = lines[i].split(b" ")
        words[int(rng.integers(len(words)))] = token
        flipped = bytes([span[0] ^ 1 << int(rng.integers(8))]) + span[1:] if span else span
        changes = [
            head + flipped + tail,
            head + tail,
            head + span * int(rng.integers(1, 40)) + tail,
            head + rng.bytes(int(rng.integers(1, 16))) + tail,
            head + token + span + tail,
            head + token * int(rng.integers(1, 4000)) + span + tail,
            head,
            b"\n".join([*lines[:i], *lines[j : j + 3], *lines[i:]]),
            b"\n".join([*lines[:i], b" ".join(words), *lines[i + 1 :]]),
        ]
        content = changes[int(rng.integers(len(changes)))]
    return content


def mutate_archive(content: bytes, rng: np.random.Generator) -> bytes:
    """Return an .npz file with changed arrays in it; a third of the time the bytes of the file are changed instead."""
    if rng.random() < 1 / 3:
        return mutate(content, rng)
    with np.load(BytesIO(content)) as file:
        arrays: dict[str, Any] = {name: file[name] for name in file.files}
    name = sorted(arrays)[int(rng.integers(len(arrays)))]
    array = arrays[name]
    way = int(rng.integers(8))
    with np.errstate(all="ignore"):
        if way == 0 and len(arrays) > 1:
            del arrays[name]
        elif way == 1:
            arrays[name] = array.ravel()
        elif way == 2:
            arrays[name] = array[..., None] if rng.random() < 0.5 else array[:0] if array.ndim else array[None]
        elif way == 3:
            kinds = ("U3", "S2") if array.dtype.kind in "USc" else ("U3", "c16", "f2", "u1", "?", "S2")
            arrays[name] = array.astype(kinds[int(rng.integers(len(kinds)))])
        elif array.dtype.kind in "iuf" and array.size:
            changed = array.astype(float if way < 6 else array.dtype).ravel()
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


def read_mutants(reader: Reader, n: int, max_seconds: float = MAX_SECONDS) -> Iterator[str]:
    """Yield how each of n mutants ended: "read", "refused", or what went wrong; mutant k is the same in every run."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        files = list(reader.write(folder))
        sound = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
        reader.read(folder)  # imports and compiles, whose time and memory do not count
        for k in range(n):
            rng = np.random.default_rng([SEED, k])
            file = files[int(rng.integers(len(files)))]
            change = mutate_archive if file.suffix == ".npz" else mutate
            mutant = {**sound, file: change(sound[file], rng)}
            file.write_bytes(mutant[file])
            yield read_mutant(reader, folder, mutant, max_seconds)
            file.write_bytes(sound[file])


def read_mutant(reader: Reader, folder: Path, mutant: Mapping[Path, bytes], max_seconds: float) -> str:
    peak_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for timer, alarm, share in TIMERS:
        signal.signal(alarm, time_out)
        signal.setitimer(timer, share * max_seconds)
    try:
        reader.read(folder)
        end = "read"
    except (InputError, OSError) as error:
        end = "refused" if not isinstance(error, TimeoutError) else f"over {max_seconds} s"
    except Exception as error:
        end = f"{type(error).__name__}: {error}"
    finally:
        for timer, _, _ in TIMERS:
            signal.setitimer(timer, 0)
    added = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak_kb)
    if added > MAX_BYTES:
        return f"takes {added // 2**20} MB"
    if {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} != mutant:
        return "files of the input were changed"
    return end


def time_out(signum: int, frame: FrameType | None) -> None:
    raise TimeoutError


@pytest.mark.parametrize("n", [6, pytest.param(500, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", READERS)
def test_a_mutated_file_is_read_or_refused(name, n):
    ends = list(read_mutants(READERS[name], n))
    assert [f"{k}: {end}" for k, end in enumerate(ends) if end not in ("read", "refused")] == []
    assert len(ends) == n


@pytest.mark.parametrize(("name", "content"), BROKE_A_READER)
def test_a_file_that_once_broke_its_reader_is_read_or_refused(name, content, tmp_path):
    (file,) = READERS[name].write(tmp_path)
    file.write_bytes(content)
    with suppress(InputError):
        READERS[name].read(tmp_path)


def test_a_robot_that_once_broke_its_reader_is_refused(tmp_path):
    file = next(file for file in READERS["robot"].write(tmp_path) if file.name == "robot.toml")
    file.write_text(file.read_text().replace('"a1", "a2"', "[" * 3000))
    with pytest.raises(InputError, match=r"robot\.toml.* cannot be read as TOML"):
        READERS["robot"].read(tmp_path)


@pytest.mark.parametrize("change", [{"unanswered": np.inf}, {"limits_rad": np.ones((3, 2, 3))}, {"optimality": 1j}])
def test_a_map_that_once_broke_its_reader_is_refused(change, tmp_path):
    (file,) = READERS["map"].write(tmp_path)
    with np.load(file) as archive:
        arrays = {**archive, **change}
    np.savez(file, **arrays)
    with pytest.raises(InputError, match=r"map\.npz: "):
        READERS["map"].read(tmp_path)

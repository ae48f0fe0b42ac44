"""Files that are damaged or made to harm: each is refused, or read correctly, in bounded time and memory."""

import os
import signal
import subprocess
import sys
import tracemalloc
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
from recorded import START_S, Written, write_recording

from learning.pps.memory import PPSMemory, load_memory, save_memory
from pps_vision.errors import InputError
from pps_vision.recordings.image_file import ImageFile, decode
from pps_vision.recordings.open import open_recording
from pps_vision.recordings.stereo_calibration import read_stereo_calibration
from pps_vision.recordings.tables import read_gaze
from pps_vision.recordings.taxels_ini import PartMap, write_taxels
from pps_vision.recordings.warnings import Problem, ProblemKind
from pps_vision.robot.skin import icub_skin

CONTACT = "((0 3 4 2) (0 0 0) (0 0 0) (0 0 0) (0 0 0) (1 0 0) (1) 10.0)"
BOM = b"\xef\xbb\xbf"


@pytest.fixture
def rec(tmp_path: Path) -> Written:
    return write_recording(tmp_path / "rec", n=4)


@contextmanager
def at_most(seconds: float) -> Iterator[None]:
    """Raise TimeoutError where the block takes longer."""

    def stop(*_: object) -> None:
        raise TimeoutError

    handler = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, handler)


@pytest.mark.parametrize(
    "text",
    [
        "yaw_deg,pitch_deg,vergence_deg\n1,5,2,5,3,5\n",
        "yaw_deg,pitch_deg,vergence_deg,yaw_deg\n1,2,3,4\n",
        "yaw_deg,pitch_deg,vergence_deg\n1,2,inf\n",
    ],
    ids=["decimal comma", "column twice", "infinite"],
)
def test_a_gaze_that_would_be_misread_is_refused(tmp_path, text):
    (tmp_path / "gaze.csv").write_text(text)
    with pytest.raises(InputError, match=r"gaze\.csv:[12]: "):
        read_gaze(tmp_path / "gaze.csv")


def test_touches_of_a_log_out_of_order_are_those_of_the_rows_that_rise(rec, tmp_path):
    """One row whose clock jumped ahead loses itself, not the rows behind it."""
    stamps = [START_S, START_S + 100, START_S + 0.05, START_S + 0.1]
    rows = [f"{i} {stamp!r} {CONTACT}" for i, stamp in enumerate(stamps)]
    (rec.folder / "skin/data.log").write_text("\n".join(rows))
    write_taxels(
        tmp_path / "taxels.ini", [PartMap("l_forearm", (0.0, 0.2), (1, 1), (3, 3), {3: np.zeros((1, 1, 2), np.int64)})]
    )
    recording = open_recording(rec.folder, taxels=tmp_path / "taxels.ini")
    assert [touch.stamp_s for touch in recording.touches] == [stamps[0], stamps[2], stamps[3]]
    assert [(p.kind, p.line) for p in recording.problems] == [(ProblemKind.STAMP, 2)]


def test_nested_brackets_in_a_skin_log_are_a_bad_row(rec, tmp_path):
    deep = f"0 {START_S!r} (({3000 * '('}{3000 * ')'} 1) 1)"
    (rec.folder / "skin/data.log").write_text(f"{deep}\n1 {START_S + 0.05!r} {CONTACT}\n")
    (tmp_path / "taxels.ini").write_text(
        "[l_forearm]\nmodality 1D\nsize 2\nnTaxels 1\next (0 1)\nbinsNum (1 1)\nMapping (3 3)\n3 (0) (0)\n"
    )
    recording = open_recording(rec.folder, taxels=tmp_path / "taxels.ini")
    assert [(p.kind, p.line) for p in recording.problems] == [(ProblemKind.ROW, 1)]
    assert len(recording.touches) == 1


def test_a_section_of_icub_eyes_that_comes_twice_is_refused(rec):
    ini = rec.folder / "icubEyes.ini"
    ini.write_text(ini.read_text() + ini.read_text().replace("fx 2", "fx 3"))
    with pytest.raises(InputError, match=r"icubEyes\.ini:\d+: section \[CAMERA_CALIBRATION_LEFT\]; expected each"):
        open_recording(rec.folder)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.yml", "%YAML:1.0\n---\nK1: " + 10**6 * "["),
        ("b.json", '{"K1": ' + 10**6 * "["),
        ("c.json", '{"K1": ' + 10**5 * '{"a": '),
        ("d.xml", '<?xml version="1.0"?>\n<opencv_storage>' + 10**5 * "<a>"),
        ("e.yml", "%YAML:1.0\n---\nK1:\n   " + 5000 * "- " + "1\n"),
        ("f.yml", "%YAML:1.0\n---\nK1: " + 5000 * "[" + 5000 * "]"),
    ],
)
def test_a_deeply_nested_calibration_is_refused(tmp_path, name, text):
    """In a separate process, since OpenCV's parser ends the one that it runs in."""
    (tmp_path / name).write_text(text)
    code = (
        "import sys; from pathlib import Path\n"
        "from pps_vision.recordings.stereo_calibration import InputError, read_stereo_calibration\n"
        "try: read_stereo_calibration([Path(sys.argv[1])], (8, 6))\n"
        "except InputError as refusal: print(refusal)"
    )
    process = subprocess.run([sys.executable, "-c", code, tmp_path / name], capture_output=True, text=True, timeout=60)
    assert (process.returncode, process.stderr) == (0, "")
    assert f"{name}: has more than" in process.stdout


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.toml", "[a]\nk" + ".b" * 1500 + " = 1\n"),
        ("b.json", '{"K1": ' + 400 * "[" + 400 * "]" + "}"),
        ("c.json", 300 * '{"a": ' + "1" + 300 * "}"),
    ],
)
def test_levels_that_a_parser_accepts_are_refused(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=rf"{name}: cannot be parsed: more than 16 levels; expected a calibration"):
        read_stereo_calibration([tmp_path / name], (8, 6))


def test_a_calibration_of_many_numbers_is_read_soon(tmp_path):
    """OpenCV's sample `calibration` also writes all corners of the board."""
    matrix = "{}: !!opencv-matrix\n  rows: {}\n  cols: {}\n  dt: d\n  data: {}\n"
    K = matrix.format("K1", 3, 3, [9.0, 0, 4, 0, 9, 3, 0, 0, 1])
    more = matrix.format("R", 3, 3, [1, 0, 0, 0, 1, 0, 0, 0, 1]) + matrix.format("T", 3, 1, [-0.1, 0, 0])
    corners = matrix.format("image_points", 1, 50_000, ["0.25"] * 50_000).replace("'", "")
    (tmp_path / "a.yml").write_text(f"%YAML:1.0\n---\n{K}{K.replace('K1', 'K2')}{more}{corners}")
    with at_most(10):
        assert read_stereo_calibration([tmp_path / "a.yml"], (8, 6))[2][0, 3] == pytest.approx(0.1)


def test_a_byte_order_mark_changes_nothing(rec):
    clean = open_recording(rec.folder)
    for file in [*rec.folder.rglob("*.log"), rec.folder / "truth.csv", rec.folder / "icubEyes.ini"]:
        file.write_bytes(BOM + file.read_bytes())
    marked = open_recording(rec.folder)
    assert marked.problems == clean.problems == []
    assert (len(marked), marked.touches, len(marked.truth)) == (len(clean), clean.touches, len(clean.truth))
    assert marked.rig is not None
    assert marked.rig.left == clean.rig.left
    assert [pair[0].stamp_s for pair in marked.pairs] == [pair[0].stamp_s for pair in clean.pairs]


def png(width: int, height: int) -> bytes:
    """A PNG whose header states a size that its data have not."""
    header = b"IHDR" + width.to_bytes(4) + height.to_bytes(4) + bytes([8, 2, 0, 0, 0])
    data = b"IDAT" + zlib.compress(bytes(64))
    chunks = [(len(c) - 4).to_bytes(4) + c + zlib.crc32(c).to_bytes(4) for c in (header, data, b"IEND")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.png", png(20_000, 20_000)),
        ("a.png", png(10_000, 10_000)),  # of which PIL only warns
        ("a.png", png(4096, 2049)),  # 2^23 pixels and a row more
        ("a.ppm", b"P6 99999 99999 255\n\x00"),
        ("a.bmp", cv2.imencode(".bmp", np.zeros((4, 4, 3), np.uint8))[1].tobytes()),
    ],
    ids=["png", "large png", "png just too large", "ppm", "bmp"],
)
def test_an_image_that_states_too_many_pixels_is_not_decoded(tmp_path, name, content):
    if name.endswith("bmp"):
        content = content[:18] + (30_000).to_bytes(4, "little") + (30_000).to_bytes(4, "little") + content[26:]
    (tmp_path / name).write_bytes(content)
    problem = decode(ImageFile(tmp_path / name, 0.0))
    assert isinstance(problem, Problem)
    assert f"{name} states " in problem.message


def test_what_is_no_regular_file_is_not_opened(rec, tmp_path):
    """A pipe that nobody writes to would block without end."""
    image = rec.folder / "cam/left/00000001.ppm"
    truth = rec.folder / "truth.csv"
    memory = tmp_path / "m.npz"
    for file in (image, truth):
        file.unlink()
    for file in (image, truth, memory):
        os.mkfifo(file)
    with at_most(20):
        with pytest.raises(InputError, match=r"truth\.csv: is a device, pipe or socket; expected a table"):
            open_recording(rec.folder)
        truth.unlink()
        recording = open_recording(rec.folder)
        assert len(list(recording)) == 3
        assert "00000001.ppm cannot be opened (is a device, pipe or socket)" in recording.problems[0].message
        with pytest.raises(InputError, match=r"m\.npz: is a device, pipe or socket; expected PPS memory"):
            load_memory(memory)
        with pytest.raises(InputError, match="zero: is a device, pipe or socket"):
            read_stereo_calibration([Path("/dev/zero")], (8, 6))


@pytest.mark.parametrize("is_memory", [True, False])
def test_a_small_archive_of_large_arrays_is_refused_unread(tmp_path, is_memory):
    """300 MB of zeros take 1 MB in an .npz file; its kind is looked at first."""
    save_memory(tmp_path / "small.npz", PPSMemory.empty(icub_skin(("left_palm",))))
    with zipfile.ZipFile(tmp_path / "small.npz") as small, zipfile.ZipFile(tmp_path / "m.npz", "w", 8) as large:
        for name in small.namelist():
            if name not in ("counts.npy", "kind.npy"):
                large.writestr(name, small.read(name))
        large.writestr("kind.npy", small.read("kind.npy" if is_memory else "version.npy"))
        with large.open("counts.npy", "w") as stream:
            header = {"descr": "<f8", "fortran_order": False, "shape": (300 * 2**17,)}
            np.lib.format.write_array_header_1_0(stream, header)
            for _ in range(300):
                stream.write(bytes(2**20))
    tracemalloc.start()
    with pytest.raises(InputError, match="states 3145.* bytes of arrays" if is_memory else "is not a PPS memory"):
        load_memory(tmp_path / "m.npz")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20e6

"""Videos that PyAV wrote with known stamps and brightness."""

import tracemalloc
from pathlib import Path

import av
import numpy as np
import pytest
from calibrations import write_calibration
from videos import number_of, write_video

from pps_vision.app.track import track
from pps_vision.errors import InputError
from pps_vision.recordings import video as reader
from pps_vision.recordings.open import open_recording
from pps_vision.recordings.recording import Recording
from pps_vision.recordings.video import Video, open_frames, open_video
from pps_vision.recordings.warnings import ProblemKind

UNEVEN = [0.0, 0.033, 0.1, 0.104, 0.25, 0.3]  # a variable frame rate


@pytest.fixture
def calib(tmp_path: Path) -> Path:
    return write_calibration(tmp_path / "calib.yml", 100.0, (80.0, 60.0))


def two(folder: Path, calib: Path, left: list[float], right: list[float], **options: float) -> Recording:
    files = [str(write_video(folder / f"{name}.mp4", stamps)) for name, stamps in (("l", left), ("r", right))]
    return open_recording(left=files[:1], right=files[1:], calib=[calib], **options)


@pytest.mark.parametrize(
    ("codec", "suffix"), [("mpeg4", "mp4"), ("mpeg4", "mkv"), ("libx264", "mp4"), ("mjpeg", "mov")]
)
def test_a_video_has_its_own_stamps(tmp_path, codec, suffix):
    frames = open_video(write_video(tmp_path / f"v.{suffix}", UNEVEN, codec), fps=None)
    np.testing.assert_allclose([frame.stamp_s for frame in frames], UNEVEN, atol=1e-9)
    for _ in range(2):
        assert [number_of(frame.load()) for frame in frames] == [*range(6)]


@pytest.mark.parametrize("codec", ["mpeg4", "libx264"])
def test_any_frame_is_found_in_any_order(tmp_path, codec):
    """B-frames, and seeking far ahead."""
    options = {"bf": "2"} if codec == "mpeg4" else {}
    video = Video(write_video(tmp_path / "v.mp4", [k / 50 for k in range(300)], codec, **options))
    numbers = [0, 250, 251, 3, 3, 299, 120, 119, 0, 130]
    assert [number_of(video.load(k)) for k in numbers] == numbers


def test_frames_between_are_decoded_but_not_converted(tmp_path, monkeypatch):
    converted = []

    class Counted:
        to_rgb = reader.VideoReformatter()

        def reformat(self, frame, **options):
            converted.append(frame.pts)
            return self.to_rgb.reformat(frame, **options)

    monkeypatch.setattr(reader, "VideoReformatter", Counted)
    video = Video(write_video(tmp_path / "v.mp4", [k / 50 for k in range(60)]))
    assert [number_of(video.load(k)) for k in (0, 40, 40, 59)] == [0, 40, 40, 59]
    assert len(converted) == 3


def test_two_threads_read_one_video_each_in_its_own_order(tmp_path, calib):
    stamps_s = [k / 20 for k in range(40)]
    recording = two(tmp_path, calib, stamps_s, stamps_s)
    for (k, ahead), (_, frame) in zip(recording.read_ahead(), recording.numbered(), strict=True):
        assert number_of(ahead.left) == number_of(frame.left) == number_of(frame.right) == k


def test_two_videos_pair_by_stamp(tmp_path, calib):
    recording = two(tmp_path, calib, [0, 0.1, 0.2, 0.3], [0.005, 0.205, 0.305])
    frames = list(recording.numbered())
    assert [number for number, _ in frames] == [0, 2, 3]
    np.testing.assert_allclose([f.stamp_left_s for _, f in frames], [0, 0.2, 0.3])
    np.testing.assert_allclose([f.stamp_right_s for _, f in frames], [0.005, 0.205, 0.305])
    assert [number_of(f.left) for _, f in frames] == [0, 2, 3]
    assert [number_of(f.right) for _, f in frames] == [0, 1, 2]
    assert recording.image_size == (160, 120)
    assert [str(p) for p in recording.problems] == [
        f"{tmp_path / 'l.mp4'}: frame 1 is unpaired; expected a right image within 20 ms"
    ]


def test_a_frame_rate_overrides_the_stamps(tmp_path, calib):
    recording = two(tmp_path, calib, UNEVEN, UNEVEN, fps=10)
    assert recording.warnings == ("--fps 10 replaces the files' own 20.00",)
    np.testing.assert_allclose([f.stamp_s for f in recording], np.arange(6) / 10)


def test_a_file_of_stamps_overrides_them_too(tmp_path, calib):
    (tmp_path / "times.txt").write_text("5\n5.5\n7\n")
    file = write_video(tmp_path / "both.mp4", [0, 0.1, 0.2])
    recording = open_recording(file, calib=[calib], times=tmp_path / "times.txt")
    assert [f.stamp_s for f in recording] == [5, 5.5, 7]
    (tmp_path / "times.txt").write_text("5\n")
    with pytest.raises(InputError, match=r"times\.txt: 1 stamps for 3 images of the video"):
        open_recording(file, calib=[calib], times=tmp_path / "times.txt")
    (tmp_path / "times.txt").write_text("5 a.png\n")
    with pytest.raises(InputError, match=r"times\.txt: names images; expected a stamp for each frame of both\.mp4"):
        open_recording(file, calib=[calib], times=tmp_path / "times.txt")


def test_one_name_is_enough_for_each_option(tmp_path, calib):
    left, right = (write_video(tmp_path / f"{side}.mp4", UNEVEN) for side in "lr")
    for opened in (open_recording(left=str(left), right=right, calib=str(calib)), two(tmp_path, calib, UNEVEN, UNEVEN)):
        assert (len(opened), opened.name, opened.rig is None) == (6, str(left), False)
    with pytest.raises(InputError, match=r"--right .*r\.mp4 without --left; expected both"):
        open_recording(right=right, calib=calib)


@pytest.mark.parametrize(("more", "warned"), [(2, False), (3, True)])
def test_a_video_that_ends_early_is_the_one_that_is_named(tmp_path, calib, more, warned):
    recording = two(tmp_path, calib, [k / 25 for k in range(17)], [k / 25 for k in range(17 + more)])
    left = tmp_path / "l.mp4"
    right = tmp_path / "r.mp4"
    said = f"{left} ends early (17 frames, 0.64 s); {right} has {more} more"
    assert recording.warnings == ((said,) if warned else ())
    (row,) = map(str, recording.problems)
    assert row.startswith(f"{right}: frame 17 to frame {16 + more} ({more}) are unpaired")
    assert recording.skipped == more


@pytest.mark.parametrize(("suffix", "share", "said"), [("mkv", 0.5, "its header states 1.96 s"), ("mkv", 1.0, "")])
def test_a_video_without_its_end(tmp_path, calib, suffix, share, said):
    file = write_video(tmp_path / f"v.{suffix}", [k / 25 for k in range(50)], size=(320, 120))
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    warnings_text = "".join(open_recording(file, calib=calib).warnings)
    assert (f"{file} ends early (" in warnings_text, said in warnings_text) == (bool(said), True)


def test_a_video_that_was_cut_before_its_index_is_refused_in_words(tmp_path):
    file = write_video(tmp_path / "v.mp4", UNEVEN)
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(InputError, match=r"v\.mp4: cannot be read: it is damaged, cut off or no video; expected a"):
        open_recording(file)


def test_side_by_side(tmp_path, calib):
    recording = open_recording(write_video(tmp_path / "both.mp4", UNEVEN, size=(320, 120)), calib=[calib])
    for _ in range(2):  # it iterates more than once
        frames = list(recording)
        np.testing.assert_allclose([f.stamp_s for f in frames], UNEVEN, atol=1e-9)
        assert {f.left.shape for f in frames} | {f.right.shape for f in frames} == {(120, 160, 3)}
        np.testing.assert_allclose([np.mean(f.right) - np.mean(f.left) for f in frames], 100, atol=2)
    bare = open_recording(tmp_path / "both.mp4")
    assert (bare.rig, len(bare)) == (None, len(UNEVEN))
    with pytest.raises(InputError, match=r"both\.mp4: holds no calibration; expected one by --calib"):
        list(track(bare))
    with pytest.raises(InputError, match="no usable frame; expected at least one readable stereo pair"):
        list(track(recording).path([], smooth=False))
    odd = write_video(tmp_path / "odd.avi", [0.0, 0.05], "mjpeg", size=(161, 120))
    with pytest.raises(InputError, match="is 161 pixels wide; expected two halves"):
        open_recording(odd, calib=[calib])


def test_frames_without_stamps_need_a_rate(tmp_path):
    file = tmp_path / "raw.avi"
    write_video(file, [k / 25 for k in range(120)], "mpeg4", bf="2")  # AVI has none for B-frames
    with pytest.raises(InputError, match="not every frame has a stamp of its own; expected --fps"):
        open_video(file, fps=None)
    frames = open_video(file, fps=25)
    assert [number_of(frame.load()) for frame in (frames[110], *frames)] == [110, *range(120)]  # they are counted


def test_a_broken_frame_is_noted_and_the_rest_is_read(tmp_path):
    file = write_video(tmp_path / "v.mkv", [k / 25 for k in range(10)], "mjpeg")
    with av.open(str(file)) as container:
        sizes = [bytes(packet) for packet in container.demux(video=0) if packet.size]
    file.write_bytes(file.read_bytes().replace(sizes[4], bytes(len(sizes[4]))))
    frames = open_frames(file)
    for _ in range(2):
        assert [k for k, _ in frames] == [1, 2, 3, 4, 6, 7, 8, 9, 10]
        assert [(p.kind, str(p)) for p in frames.problems] == [
            (ProblemKind.IMAGE, f"{file}: frame 4 is missing; expected an image")
        ]


def test_memory_does_not_grow_with_the_video(tmp_path):
    frames = open_video(write_video(tmp_path / "v.mp4", [k / 50 for k in range(200)]), fps=None)
    peaks = []
    for n in (10, 200):
        tracemalloc.start()
        for frame in frames[:n]:
            frame.load()
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < peaks[0] + 2 * 160 * 120 * 3


def test_a_video_of_no_frames_of_too_many_pixels_or_of_an_unknown_kind_is_refused(tmp_path, monkeypatch):
    file = write_video(tmp_path / "v.avi", UNEVEN[:2], "mjpeg")
    whole = file.read_bytes()
    file.write_bytes(whole[: whole.index(b"movi") + 4])
    with pytest.raises(InputError, match=r"v\.avi: 0 frames of 160×120 pixels; expected frames of at most"):
        Video(file)
    file.write_bytes(whole.replace(b"MJPG", b"xqzw"))
    with pytest.raises(InputError, match=r"v\.avi: cannot be read: no decoder for it"):
        Video(file)
    with pytest.raises(InputError, match="is a folder; expected a video"):
        Video(tmp_path)
    file.write_bytes(whole)
    monkeypatch.setattr(reader, "MOST_PIXELS", 160 * 120)
    video = Video(file)
    monkeypatch.setattr(reader, "MOST_PIXELS", 160 * 120 - 1)
    with pytest.raises(
        InputError, match=r"v\.avi: \d frames of 160×120 pixels; expected frames of at most 19199 pixels"
    ):
        Video(file)
    assert isinstance(video.load(0), str), "nor is a frame decoded that turns out to be larger than its header says"


@pytest.mark.parametrize(
    "content", [b"", b"no video", b"ffconcat version 1.0\nfile other.mp4\n", b"#EXTM3U\nother.mp4\n"]
)
def test_what_is_no_video_is_refused(tmp_path, content):
    """Playlists are none: they could name any file."""
    write_video(tmp_path / "other.mp4", UNEVEN)
    (tmp_path / "v.mp4").write_bytes(content)
    with pytest.raises(InputError, match=r"v\.mp4: .*expected"):
        Video(tmp_path / "v.mp4")
    with pytest.raises(InputError, match="cannot be read"):
        Video(tmp_path / "gone.mp4")

"""Which files `track` writes, and which pairs its pictures are of."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from videos import write_video

from pps_vision.app.cli import main


@pytest.mark.parametrize(("n", "chosen"), [(3, [0, 1, 2]), (20, [1, 4, 7, 10, 13, 16, 19])])
def test_a_report_has_at_most_eight_pictures_spread_over_the_recording(
    n: int, chosen: list[int], tmp_path: Path, calib: Path
) -> None:
    """Identified by their content: the video's images, enlarged twice, left beside right."""
    write_video(tmp_path / "a.mp4", [k / 20 for k in range(n)])
    main(["track", str(tmp_path / "a.mp4"), "--calib", str(calib), "--report", "--out", str(tmp_path / "out")])
    names = {"detections.csv", "trajectory.csv", "summary.json", "report.html", "keyframes"}
    assert {file.name for file in (tmp_path / "out").iterdir()} == names
    numbers = []
    for k in range(len(list((tmp_path / "out" / "keyframes").iterdir()))):
        picture = cv2.imread(str(tmp_path / "out" / "keyframes" / f"{k}.jpg"))
        assert picture is not None
        assert picture.shape == (240, 320, 3)
        bands = np.array_split(picture[:, 200:300].mean(axis=(1, 2)), 10)[1:]  # the first is under the words
        numbers.append(sum((float(np.median(band)) > 155) << bit for bit, band in enumerate(bands, start=1)))
    assert numbers == [k // 2 * 2 for k in chosen]

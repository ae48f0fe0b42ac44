"""Left and right images by their stamps."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from pps_vision.errors import InputError
from pps_vision.recordings.image_file import ImageFile
from pps_vision.recordings.recording import Recording, distinct_stamps, pair_by_stamp, usual_size
from pps_vision.recordings.warnings import Problem, ProblemKind


def images(side: str, stamps: list[float]) -> list[ImageFile]:
    log = Path(side) / "data.log"
    return [ImageFile(log.with_name(f"{i}.ppm"), t, log=log, line=i) for i, t in enumerate(sorted(stamps), start=1)]


def pair(left: list[float], right: list[float], skew: float = 0.02) -> tuple[list[tuple[float, float]], list[Problem]]:
    problems: list[Problem] = []
    pairs = pair_by_stamp(images("left", left), images("right", right), skew, problems)
    return [(a.stamp_s, b.stamp_s) for a, b in pairs], problems


@pytest.mark.parametrize("skew", [-0.1, float("nan"), float("inf")])
def test_a_tolerance_must_be_a_time(skew):
    with pytest.raises(ValueError, match=r"max_skew_s .* expected a finite time"):
        pair([0.0], [0.0], skew)


def test_eyes_half_a_frame_apart_lose_no_pair():
    rng = np.random.default_rng(3)
    left = np.arange(50) / 30 + rng.uniform(-0.001, 0.001, 50)
    right = np.arange(50) / 30 + 1 / 60 + rng.uniform(-0.001, 0.001, 50)
    pairs, _ = pair(list(left), list(right))
    assert pairs == list(zip(left, right, strict=True))


@pytest.mark.parametrize("apart_s", [(0.05, 0.08), (0.004, 0.02)], ids=["far apart", "several within the tolerance"])
@pytest.mark.parametrize("seed", range(3))
def test_jittered_eyes_pair_as_the_optimal_assignment(seed, apart_s):
    rng = np.random.default_rng(seed)
    true = np.cumsum(rng.uniform(*apart_s, 40))
    keep = rng.random((2, 40)) > 0.2
    left, right = (sorted(true[k] + rng.uniform(-0.006, 0.006, k.sum())) for k in keep)
    cost = np.abs(np.subtract.outer(left, right))
    rows, columns = linear_sum_assignment(np.where(cost <= 0.02, cost, 2 * 0.02))  # two unpaired images cost as much
    best = {(left[i], right[j]) for i, j in zip(rows, columns, strict=True) if cost[i, j] <= 0.02}
    assert set(pair(left, right)[0]) == best


def test_of_several_files_with_one_stamp_the_first_is_kept_and_the_others_are_named():
    files = [ImageFile(Path(name), stamp_s) for name, stamp_s in (("c", 2.0), ("a", 1.0), ("b", 1.0), ("d", 2.0))]
    problems: list[Problem] = []
    assert [file.path.name for file in distinct_stamps(files, problems)] == ["a", "c"]
    assert [(problem.kind, "has the stamp of" in str(problem)) for problem in problems] == [
        (ProblemKind.STAMP, True)
    ] * 2


def test_where_both_sides_must_be_of_one_size_the_other_is_named(tmp_path):
    pairs = []
    for k, left in enumerate([(4, 3), (5, 3), (6, 3)]):
        for side, (width, height) in (("L", left), ("R", (8, 6))):
            cv2.imwrite(str(tmp_path / f"{side}{k}.png"), np.zeros((height, width, 3), np.uint8))
        pairs.append((ImageFile(tmp_path / f"L{k}.png", float(k)), ImageFile(tmp_path / f"R{k}.png", float(k))))
    with pytest.raises(InputError, match=r"R0\.png: 8×6 pixels; left images are 4×3; expected one size"):
        usual_size("made up", tuple(pairs), [])


@pytest.mark.parametrize(
    ("stamps", "fps"), [([0.0, 0.1, 0.2, 0.9], 10.0), ([0.0, 0.25], 4.0), ([0.0], 20.0), ([], 20.0), ([1.0, 1.0], 20.0)]
)
def test_the_rate_is_that_of_the_median_interval(stamps, fps):
    pairs = tuple((ImageFile(Path("l"), t), ImageFile(Path("r"), t)) for t in stamps)
    assert Recording("made up", pairs, (8, 6), []).fps == pytest.approx(fps)


def test_the_usual_size_is_that_of_the_first_images(tmp_path):
    """Five pairs, ten images, are compared; later ones are not read, and do not count."""
    pairs = []
    for k in range(12):
        file = tmp_path / f"{k}.png"
        cv2.imwrite(str(file), np.zeros((6, 8, 3) if k < 5 else (12, 16, 3), np.uint8))
        pairs.append((ImageFile(file, float(k)), ImageFile(file, float(k))))
    assert usual_size("made up", tuple(pairs), []) == (8, 6)
    assert usual_size("made up", tuple(pairs[3:]), []) == (16, 12)
    large_at = (0, 1, 5, 6)  # a majority of four pairs, and half of six: only of five have most the small size
    mixed = [pairs[11 - k if k in large_at else k % 5] for k in range(8)]
    assert usual_size("made up", tuple(mixed), []) == (8, 6)
    (tmp_path / "0.png").unlink()
    assert usual_size("made up", tuple(pairs), []) == (8, 6)
    with pytest.raises(InputError, match="no usable frame"):
        usual_size("made up", tuple(pairs[:1]), [])

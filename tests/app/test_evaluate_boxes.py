"""Boxes against boxes: closed forms, motmetrics, and the files of other tools."""

import json

import motmetrics
import numpy as np
import pytest
from data import SEED
from pycocotools.mask import iou as coco_iou

from pps_vision.app.cli import main
from pps_vision.app.evaluate_boxes import Boxes, evaluate_boxes, per_frame, precision, read_boxes, success
from pps_vision.errors import InputError


def one(*boxes: tuple[float, float, float, float] | None) -> Boxes:
    """A box a frame, from frame 1 on."""
    frames = enumerate(boxes, start=1)
    return Boxes("one", {k: {} if box is None else {1: np.array(box, dtype=float)} for k, box in frames})


def test_success_and_precision_by_hand():
    """Overlaps 1, 1/3, 0 (no box); centres off by 0, 5 and not there; a frame without a true box does not count."""
    truth = one((0, 0, 10, 10), (0, 0, 10, 10), (0, 0, 10, 10), None)
    track = one((0, 0, 10, 10), (5, 0, 10, 10), None, (1, 1, 2, 2))
    iou, distance = per_frame(track, truth)
    np.testing.assert_allclose(iou, [1, 1 / 3, 0])
    np.testing.assert_allclose(distance, [0, 5, np.inf])
    expected = [np.mean([t < 1, t < 1 / 3, t < 0]) for t in np.arange(21) / 20]
    np.testing.assert_allclose(success(iou), expected)
    np.testing.assert_allclose(precision(distance), [1 / 3] * 5 + [2 / 3] * 46)
    score = evaluate_boxes(track, truth)
    assert (score.boxes, score.center_median_px, score.id_switches) == (3, 2.5, 0)
    np.testing.assert_allclose([score.mean_iou, score.success_auc], [4 / 9, np.mean(expected)])
    np.testing.assert_allclose([score.missed_share, score.false_share, score.mota], [2 / 3, 2 / 3, -1 / 3])


def crossing(rng: np.random.Generator) -> tuple[Boxes, Boxes]:
    """Three objects that cross; a tracker that misses some, invents some, and exchanges names."""
    truth: dict[int, dict[int, np.ndarray]] = {}
    track: dict[int, dict[int, np.ndarray]] = {}
    names = np.array([11, 12, 13])
    for frame in range(1, 80):
        truth[frame] = {}
        track[frame] = {}
        if rng.random() < 0.1:
            names = rng.permutation(names)
        for k in range(3):
            box = np.array([100 + 60 * np.sin(0.07 * frame * (k + 1)), 50 + 12 * k, 30, 40])
            if rng.random() < 0.95:
                truth[frame][k] = box
            if rng.random() < 0.85:
                track[frame][int(names[k])] = box + rng.normal(0, 3, 4)
        if rng.random() < 0.2:
            track[frame][99] = np.array([*rng.uniform(0, 200, 2), 30, 40])
    return Boxes("track", track), Boxes("truth", truth)


@pytest.mark.filterwarnings("ignore")  # motmetrics uses what pandas will remove
def test_misses_and_switches_are_motmetrics():
    """With the overlaps of pycocotools."""
    track, truth = crossing(np.random.default_rng(SEED))
    theirs = motmetrics.MOTAccumulator(auto_id=False)
    for frame, true in truth.frames.items():
        boxes = track.frames[frame]
        iou = coco_iou(list(boxes.values()), list(true.values()), [0] * len(true)) if true and boxes else []
        iou = np.reshape(iou, (len(boxes), len(true))).T
        theirs.update(list(true), list(boxes), np.where(iou >= 0.5, 1 - iou, np.nan), frameid=frame)
    metrics = ["mota", "num_switches", "num_misses", "num_false_positives", "num_objects"]
    row = motmetrics.metrics.create().compute(theirs, metrics=metrics).iloc[0]
    score = evaluate_boxes(track, truth)
    assert row["num_switches"] > 5
    assert (score.id_switches, score.boxes) == (row["num_switches"], row["num_objects"])
    np.testing.assert_allclose(
        [score.mota, score.missed_share, score.false_share],
        [row["mota"], row["num_misses"] / row["num_objects"], row["num_false_positives"] / row["num_objects"]],
    )
    assert np.isnan(score.success_auc)


def test_files_of_other_tools(tmp_path, capsys):
    """Rectangles of OTB and MOTChallenge, whose pixels count from 1, polygons of VOT and our table say the same."""
    rows = np.array([[10, 20, 30, 40.0], [12, 21, 30, 40], [14, 22, 30, 41]])
    np.savetxt(tmp_path / "otb.txt", rows + np.array([1, 1, 0, 0]), "%g", delimiter="\t")
    corners = [(x, y, x + w, y, x + w, y + h, x, y + h) for x, y, w, h in rows]
    np.savetxt(tmp_path / "vot.txt", corners, "%g", delimiter=",")
    (tmp_path / "mot.txt").write_text(
        "".join(f"{k},7,{x + 1},{y + 1},{w},{h},1,-1,-1,-1\n" for k, (x, y, w, h) in enumerate(rows, 1))
    )
    ours = "".join(f"{k},{x},{y},{w},{h},0.5\n" for k, (x, y, w, h) in enumerate(rows, 1))
    (tmp_path / "ours.csv").write_text("frame,x,y,w,h,score\n" + ours)
    files = [str(tmp_path / name) for name in ("ours.csv", "mot.txt", "vot.txt", "otb.txt")]
    main(["evaluate", "--boxes", *files, "--json", "--figure", str(tmp_path / "curves.png")])
    for score in json.loads(capsys.readouterr().out):
        assert (score["mean_iou"], score["mota"], score["precision_20px"]) == (1, 1, 1)
    assert (tmp_path / "curves.png").stat().st_size > 10_000
    main(["evaluate", "--boxes", *files])
    assert len(capsys.readouterr().out.splitlines()) == 4
    main(["evaluate", "--boxes", *files[2:], "--first-px", "0", "--json"])
    assert json.loads(capsys.readouterr().out)[0]["mean_iou"] < 1


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("1,2,3\n", "a:1: fewer than 6"),
        ("1,1,2,3,x,5,1\n", "a:1: "),
        ("1,1.5,2,3,4,5,1\n", "a:1: frame 1, track 1.5"),
        ("0,1,2,3,4,5,1\n", "a:1: frame 0, track 1; .*frames from 1"),
        ("1,1,2,3,4,5,1\n1,1,2,3,4,5,1\n", "a:2: track 1 twice"),
        ("nan,nan,nan,nan\n", "no box"),
        ("1,2,3,4,5,6,7,x\n", "a:1: "),
    ],
)
def test_a_bad_file_is_named(tmp_path, content, message):
    (tmp_path / "a").write_text(content)
    with pytest.raises(InputError, match=message):
        read_boxes(tmp_path / "a")


def test_several_boxes_in_a_frame_have_no_success_curve():
    single = Boxes("one", {1: {1: (0, 0, 4, 4)}})
    two = Boxes("two", {1: {1: (0, 0, 4, 4), 2: (9, 9, 4, 4)}})
    for pair in ((single, two), (two, single)):
        with pytest.raises(InputError, match="two: 2 boxes in frame 1; expected one for a success curve"):
            per_frame(*pair)
    score = evaluate_boxes(two, two)
    assert np.isnan([score.mean_iou, score.success_auc, score.precision_20px, score.center_median_px]).all()
    assert (score.boxes, score.mota) == (2, 1)

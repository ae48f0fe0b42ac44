"""`track2d`: a block that moves over a grey wall, in each form, and the messages."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from data import SEED
from nano import write_weights

from pps_vision.app.cli import main
from pps_vision.app.evaluate_boxes import evaluate_boxes, read_boxes

N = 6
INIT = ("--init", "20", "30", "24", "20")


def box(k: int) -> tuple[int, int, int, int]:
    return 20 + 3 * k, 30 + k, 24, 20


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    """Images 1 to 6 of 120×90 pixels, with a blue block."""
    rng = np.random.default_rng(SEED)
    folder = tmp_path / "frames"
    folder.mkdir()
    for k in range(N):
        image = np.clip(90 + rng.normal(0, 4, (90, 120, 3)), 0, 255).astype(np.uint8)
        x, y, w, h = box(k)
        image[y : y + h, x : x + w] = (230, 120, 30)
        cv2.imwrite(str(folder / f"{k + 1}.png"), image)
    return folder


def test_every_form_holds_the_boxes(frames, tmp_path, capsys):
    (tmp_path / "truth.csv").write_text(
        "frame,x,y,w,h,score\n" + "".join(f"{k + 1},{','.join(map(str, box(k)))},1\n" for k in range(N))
    )
    files = {form: tmp_path / f"boxes.{form}" for form in ("csv", "mot", "coco")}
    for form, file in files.items():
        main(["track2d", str(frames), *INIT, "--form", form, "--out", str(file)])
        said = capsys.readouterr()
        assert said.out == f"found in 6 of 6 frames (score ≥ 0.5) → {file}\n"
        assert "warning" not in said.err
    for form in ("csv", "mot"):
        assert evaluate_boxes(read_boxes(files[form]), read_boxes(tmp_path / "truth.csv")).mean_iou > 0.95
    coco = json.loads(files["coco"].read_text())
    rows = np.loadtxt(files["csv"], delimiter=",", skiprows=1)
    assert [image["file_name"] for image in coco["images"]] == [str(frames / f"{k + 1}.png") for k in range(N)]
    assert [(image["frame_id"], image["width"], image["height"]) for image in coco["images"]] == [
        (k + 1, 120, 90) for k in range(N)
    ]
    written = [[row["image_id"], *row["bbox"], row["score"]] for row in coco["annotations"]]
    np.testing.assert_allclose(written, rows, atol=1e-4)


def test_an_image_that_cannot_be_read_has_no_box(frames, tmp_path, capsys):
    (frames / "3.png").write_bytes(b"")
    for form in ("csv", "coco"):
        main(["track2d", str(frames), *INIT, "--form", form, "--out", str(tmp_path / form)])
        said = capsys.readouterr()
        assert "found in 5 of 5 frames" in said.out
        assert [line for line in said.err.splitlines() if "skipped" in line and "3.png" in line]
    assert sorted(read_boxes(tmp_path / "csv").frames) == [1, 2, 4, 5, 6]
    coco = json.loads((tmp_path / "coco").read_text())
    assert [row["image_id"] for row in coco["annotations"]] == [1, 2, 4, 5, 6]
    assert len(coco["images"]) == N


def test_csrt_follows_the_block_too(frames, tmp_path, capsys):
    main(["track2d", str(frames), *INIT, "--tracker", "csrt", "--out", str(tmp_path / "boxes.csv")])
    assert "found in 6 of 6 frames" in capsys.readouterr().out
    boxes = read_boxes(tmp_path / "boxes.csv")
    assert sorted(boxes.frames) == list(range(1, N + 1))
    rows = np.loadtxt(tmp_path / "boxes.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(rows[:, 1:5], [box(k) for k in range(N)], atol=3)
    assert (rows[:, 5] >= 0.5).all()


@pytest.mark.filterwarnings("ignore")
def test_nanotrack_follows_the_block_with_the_weights_of_a_folder(frames, tmp_path, monkeypatch, capsys):
    weights = write_weights(tmp_path / "weights", monkeypatch)
    words = ["track2d", str(frames), *INIT, "--nano-weights", str(weights), "--out", str(tmp_path / "boxes.csv")]
    main(words)
    assert "of 6 frames" in capsys.readouterr().out
    rows = np.loadtxt(tmp_path / "boxes.csv", delimiter=",", skiprows=1)
    centers = rows[:, 1:3] + rows[:, 3:5] / 2
    np.testing.assert_allclose(centers, [np.add(box(k)[:2], np.array(box(k)[2:]) / 2) for k in range(N)], atol=6)
    (weights / "my_head.onnx").write_bytes(b"no network")
    for expected in ("NanoTrack's weights", "expected one file *head*.onnx"):
        with pytest.raises(SystemExit):
            main(words)
        assert expected in capsys.readouterr().err
        (weights / "my_head.onnx").unlink(missing_ok=True)


def test_an_object_like_its_surroundings_is_warned_of_and_not_found(frames, tmp_path, capsys):
    """A piece of the bare wall."""
    folder = tmp_path / "wall"
    folder.mkdir()
    for k in (5, 6):
        shutil.copy(frames / f"{k}.png", folder)
    words = ["track2d", str(folder), "--init", "75", "60", "20", "20"]
    main([*words, "--out", str(tmp_path / "boxes.csv")])
    said = capsys.readouterr()
    assert "warning: the object's colours and those of its surroundings are alike" in said.err
    assert "try --tracker csrt" in said.err
    assert "found in 1 of 2 frames" in said.out
    main([*words, "--tracker", "csrt", "--out", str(tmp_path / "boxes.csv")])
    assert "warning" not in capsys.readouterr().err

"""`track --device`: the same path as without; refused options."""

import json
from pathlib import Path

import numpy as np
import torch

from pps_vision.app.cli import main


def _path(folder: Path) -> np.ndarray:
    rows = (folder / "trajectory.csv").read_text().splitlines()[1:]
    return np.array([[float(cell or "nan") for cell in row.split(",")[1:4]] for row in rows])


def test_in_batches_the_path_is_the_same(tmp_path):
    recording = tmp_path / "recording"
    words = "--stimulus marker --motion circle --seconds 1 --noise 2 --seed 3"
    main(["render", *words.split(), "--out", str(recording)])
    for name, device in (("alone", []), ("batches", ["--device", "cpu"])):
        main(["track", str(recording), "--mode", "marker", *device, "--out", str(tmp_path / name)])
        total = json.loads((tmp_path / name / "summary.json").read_text())["ms_per_pair"]["total"]
        assert total["runs"] == 20
    alone = _path(tmp_path / "alone")
    batches = _path(tmp_path / "batches")
    assert np.isfinite(alone[4:]).all()
    assert np.allclose(alone, batches, rtol=0, atol=1e-4, equal_nan=True)


def test_what_it_cannot_do_is_refused(approach, tmp_path, refused):
    out = ("--out", tmp_path / "out")
    images = ("--left", "a*.png", "--right", "b*.png", "--calib", "c.yml")
    for option in ("--map", "--memory"):
        assert f"{option} a.npz with --left" in refused("track", *images, option, "a.npz", *out)
    assert "--device tpu" in refused("track", approach, "--device", "tpu", *out)
    missing = f"cuda:{torch.cuda.device_count()}"
    line = refused("track", approach, "--device", missing, *out)
    assert f"--device {missing}" in line
    assert "expected cpu" in line

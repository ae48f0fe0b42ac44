"""Disparity on a real rectified pair (Middlebury 2014): whole maps, and windows of the size of an object."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from pps_vision.experiments.chart import timed
from pps_vision.experiments.stereo_methods import Grey
from pps_vision.types import Array

_RANGE_PX = 64
_HALF_PX = 13  # of a window: the middle of a ball of 7 cm 0.3 m away


def motorcycle(folder: Path, n: int, rng: np.random.Generator) -> dict[str, Any]:
    """`maps`: bad-2 of the matched pixels and of all, share matched, ms.  `windows`: n of them; a disparity (the
    maps' median) more than 2 px from the true median is bad."""
    left, right = (
        cv2.imread(str(folder / f"motorcycle_{side}.png"), cv2.IMREAD_GRAYSCALE) for side in ("left", "right")
    )
    if left is None or right is None:
        raise ValueError(f"{folder}: expected motorcycle_left.png and motorcycle_right.png")
    with np.load(folder / "motorcycle_disp.npz", allow_pickle=False) as file:
        truth: Array = file[file.files[0]]
    a, b = np.asarray(left, np.uint8), np.asarray(right, np.uint8)
    maps: dict[str, Array] = {}
    numbers: dict[str, Any] = {"maps": {}}
    for name in ("BM", "SGBM"):
        maps[name], ms = timed(lambda name=name: _map(name, a, b))  # type: ignore[misc]
        numbers["maps"][name] = {**_bad2(maps[name], truth), "ms": ms}
    numbers["windows"] = _windows(a, b, truth, maps, n, rng)
    return numbers


def _map(name: str, left: Grey, right: Grey) -> Array:
    """(h, w) disparities, NaN where there is none."""
    if name == "BM":
        matcher: cv2.StereoMatcher = cv2.StereoBM.create(_RANGE_PX, 15)
    else:
        matcher = cv2.StereoSGBM.create(0, _RANGE_PX, 5, P1=8 * 25, P2=32 * 25, uniquenessRatio=5)
    disparity = np.asarray(matcher.compute(left, right), dtype=float) / 16
    return np.where(disparity >= 0, disparity, np.nan)


def _bad2(disparity: Array, truth: Array) -> dict[str, float]:
    known, matched = np.isfinite(truth), np.isfinite(truth) & np.isfinite(disparity)
    bad = int(np.count_nonzero(np.abs(disparity[matched] - truth[matched]) > 2))
    n, unmatched = int(known.sum()), int(known.sum() - matched.sum())
    return {
        "bad2_of_matched": bad / int(matched.sum()),
        "bad2_of_all": (bad + unmatched) / n,
        "matched": 1 - unmatched / n,
    }


def _windows(
    left: Grey, right: Grey, truth: Array, maps: dict[str, Array], n: int, rng: np.random.Generator
) -> dict[str, Any]:
    names = [*(f"whole {name}" for name in maps), *(f"{name} in windows" for name in maps)]
    errors: dict[str, list[float]] = {name: [] for name in names}
    ms: dict[str, list[float]] = {name: [] for name in errors if not name.startswith("whole")}
    margin = _HALF_PX + 12
    while len(errors[names[0]]) < n:
        y, x = (
            int(rng.integers(margin, truth.shape[0] - margin)),
            int(rng.integers(_RANGE_PX + margin, truth.shape[1] - margin)),
        )
        window = np.s_[y - _HALF_PX : y + _HALF_PX + 1, x - _HALF_PX : x + _HALF_PX + 1]
        if np.isfinite(truth[window]).mean() < 0.9:
            continue
        true = float(np.nanmedian(truth[window]))
        for name, whole in maps.items():
            errors[f"whole {name}"].append(_median(whole[window]) - true)
            crop = np.s_[y - margin : y + margin + 1, x - margin - _RANGE_PX : x + margin + 1]
            part, took = timed(lambda name=name, crop=crop: _map(name, left[crop].copy(), right[crop].copy()))  # type: ignore[misc]
            middle = part[margin - _HALF_PX : margin + _HALF_PX + 1, -margin - _HALF_PX - 1 : _HALF_PX - margin]
            errors[f"{name} in windows"].append(_median(middle) - true)
            ms[f"{name} in windows"].append(took)
    return {name: _summary(np.array(of), ms.get(name)) for name, of in errors.items()}


def _median(disparity: Array) -> float:
    good = disparity[np.isfinite(disparity)]
    return float(np.median(good)) if len(good) >= 0.3 * disparity.size else np.nan


def _summary(error: Array, ms: list[float] | None) -> dict[str, float]:
    answered = np.isfinite(error)
    return {
        "bad2_of_answered": float(np.mean(np.abs(error[answered]) > 2)),
        "answered": float(answered.mean()),
        **({} if ms is None else {"ms": float(np.median(ms))}),
    }

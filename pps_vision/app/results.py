"""Types of the JSON files that commands write and read back, and their reader."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import NotRequired, TypedDict, TypeVar

from typeguard import CollectionCheckStrategy, TypeCheckError, check_type

from pps_vision.errors import InputError, first_line
from pps_vision.files import read_bytes
from pps_vision.recordings import SUMMARY

T = TypeVar("T")


class StageTimes(TypedDict):
    """Milliseconds of a stage: median and quartiles, and the number of its runs."""

    q25_ms: float
    median_ms: float
    q75_ms: float
    runs: int


class Size(TypedDict):
    """Median diameter of the object and its 95 % interval, m."""

    diameter_m: float
    low_95_m: float
    high_95_m: float


class Reprojection(TypedDict):
    """Points of one camera beside the filter's predictions from the past: number of pairs, median distance, mean
    NIS and the share outside the 95 % ellipse, each with its expected value."""

    pairs: int
    median_px: float | None
    nis: float | None
    nis_expected: float
    outside_95: float | None
    outside_95_expected: float


class TrackNumbers(TypedDict):
    """Results of one track: the number of its frames by status and of those in which it was attended."""

    track_id: int
    first_s: float
    last_s: float
    attended: int
    tracking: int
    coasting: int
    object: NotRequired[Size]
    residual_px: float | None
    errors: NotRequired[Mapping[str, float | None]]
    name: NotRequired[str]
    outliers: NotRequired[int]
    reprojection: NotRequired[dict[str, Reprojection]]  # left and right camera


class SearchSummary(TypedDict):
    """Counts of the search for the object, and what to try."""

    counts: dict[str, int]
    advice: list[str]


class TrackSummary(TypedDict):
    """Settings and results of `track`; a number that does not exist is null."""

    source: str
    mode: str
    reduction: int
    device: str | None
    seed: int
    pairs: int
    frames: int
    status: dict[str, int]  # number of frames by status
    followed_by: dict[str, int]  # number of frames by cue
    ms_per_pair: dict[str, StageTimes]
    cameras: Mapping[str, float | None]
    skipped: dict[str, int]  # number of problems by kind
    warnings: list[str]
    object: NotRequired[Size]
    residual_px: NotRequired[float | None]
    diagnosis: NotRequired[SearchSummary]
    errors: NotRequired[Mapping[str, float | None]]
    objects: NotRequired[int]  # largest number at a time
    tracks: NotRequired[list[TrackNumbers]]  # the longest attended first
    points: NotRequired[Mapping[str, object]]  # noise of the image points
    clock: NotRequired[Mapping[str, object]]  # delay of the right camera's stamps, and of the joints
    smoothed: NotRequired[bool]
    joints: NotRequired[str | None]
    map: NotRequired[str | None]
    memory: NotRequired[str | None]
    joint_offsets_deg: NotRequired[dict[str, float]]  # added to the encoders, as the memory was learned with them
    reach: NotRequired[Mapping[str, float]]  # max_fp, and the number of frames by reachability
    versions: NotRequired[dict[str, str]]
    command: NotRequired[str]


class BatchSummary(TypedDict):
    """Settings and results of `batch`."""

    command: str
    settings: dict[str, object]
    recordings: int
    failed: int
    started: str
    seconds: float
    versions: dict[str, str]


def read_result(file: Path, kind: type[T], expected: str) -> T:
    """The content of a JSON file of this type; InputError, ending in `expected`, for any other."""
    try:
        content = json.loads(read_bytes(file, expected), parse_float=_finite, parse_constant=_finite, parse_int=_whole)
        return check_type(content, kind, collection_check_strategy=CollectionCheckStrategy.ALL_ITEMS)
    except (ValueError, RecursionError, TypeCheckError) as error:
        raise InputError(file, f"{first_line(error)}; expected {expected}") from error


def read_track_summary(folder: Path) -> TrackSummary:
    """The summary of a tracked recording; InputError if there is none."""
    file = folder / SUMMARY
    expected = "the summary of a tracked recording"
    summary = read_result(file, TrackSummary, expected)
    if summary["frames"] < 1 or "total" not in summary["ms_per_pair"]:
        raise InputError(file, f"has no frames or no times; expected {expected}")
    return summary


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is no finite number")
    return value


def _whole(text: str) -> int:
    value = int(text)
    if abs(value) >= 2**63:
        raise ValueError(f"{text} is too large")
    return value

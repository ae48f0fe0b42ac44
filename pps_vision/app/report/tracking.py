"""The report of a tracked recording, made from the files that `track` has written: `pps-vision report`."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pps_vision.app.batch import TRACK_TABLE
from pps_vision.app.report import page
from pps_vision.app.report.colors import track_hex
from pps_vision.app.report.path3d import PATH_SCRIPT, distance_and_ttc_of_origin, path3d
from pps_vision.app.results import BatchSummary, TrackSummary, read_result, read_track_summary
from pps_vision.app.track_statistics import UNSEEN
from pps_vision.errors import InputError
from pps_vision.recordings import BATCH, KEY_FRAMES, REPORT, SUMMARY, tables
from pps_vision.recordings.yarp_text import STAMP_LIMIT_S
from pps_vision.types import Array, Mask, Status

_COLORS = {Status.TRACKING: "#2a9d4a", Status.COASTING: "#e0a020", Status.LOST: "#d33", Status.SEARCHING: "#999"}
_FEW_TRACKED = 0.5  # share of pairs, below which the report says so first
_MOST_LABELS = 6  # tracks that are named in a figure
_MOST_NAMES = 80  # recordings of a batch that are named in its figure
_WARNINGS = """
{% if warnings %}<ul class="warnings">{% for text in warnings %}<li>{{ text }}</li>{% endfor %}</ul>
{% else %}<p>No warnings.</p>{% endif %}"""
_ANSWERS = """
<dl class="answers"><dt>Did it work?</dt><dd>{{ worked }}</dd><dt>How exact?</dt><dd>{{ exact }}</dd>
<dt>What to distrust?</dt><dd>{{ warnings }}</dd></dl>"""
_UNNOTICED = (
    "Nothing was noticed. A calibration of the wrong scale shows in none of these numbers: compare the object's size "
    "with a ruler."
)
_LARGEST_VIDEO = 20 * 2**20


class TrackPath(NamedTuple):
    """Path of a track from the first pair in which it is known to the last, NaN in between where it is not."""

    stamps_s: Array  # (m,)
    state: Array  # (m, 6) position and velocity, m and m/s
    is_attended: Mask  # (m,)


@dataclass(frozen=True)
class Tracked:
    """Paths of a tracked recording, one row for each pair, and its skin."""

    stamps_s: Array  # (n,)
    position: Array  # (n, 3) m, of the attended object; NaN where unknown
    cov: Array  # (n, 3, 3) m²
    status: Array  # (n,)
    paths: Mapping[int, TrackPath]  # path of each track by its number
    reach: Array | None  # (n,) degree of reachability, NaN where unknown; None without a map
    activation: Mapping[str, Array]  # activation (n,) of every taxel, by its name; empty without a memory
    truth: Array  # (m, 4) stamp and true position; (0, 4) without one


def report_folder(folder: Path) -> str:
    """Write the report of a tracked recording, or of a batch and all its recordings; return how much was tracked.

    InputError if the folder is of neither, or one of its files cannot be read.
    """
    if not any((folder / name).is_file() for name in (SUMMARY, BATCH)):
        expected = "a folder that track or batch has written"
        raise InputError(folder, f"holds neither summary.json nor batch.csv; expected {expected}")
    if not (folder / BATCH).is_file():
        write_report(folder)
        return _measured(read_track_summary(folder))
    rows = [row for _, row in tables.read_table(folder / BATCH, ["name", "status"], exact=True)]
    tracked = [name for name, status in rows if status == "done"]
    for name in tracked:
        write_report(folder / name)
    write_batch_report(folder)
    return f"{len(tracked)} of {len(rows)} recordings tracked"


def _read_tracked(folder: Path, source: Path) -> Tracked:
    """Read what `track` has written, and the truth from the recording's folder `source`."""
    file = folder / "trajectory.csv"
    with_map = ["reach_degree"] if "reach_degree" in tables.column_names(file) else []
    columns = ["stamp_s", "x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s", *tables.COVARIANCE, *with_map, "track_id"]
    all_rows = tables.read_table(file, [*columns, "status"])
    rows = tables.attended_rows(all_rows)
    if not rows:
        raise InputError(file, "has no rows; expected one for each pair of images")
    all_values = _numbers(file, all_rows, len(columns))
    for (line, _), stamp_s in zip(all_rows, all_values[:, 0], strict=True):
        if not abs(stamp_s) < STAMP_LIMIT_S:
            raise InputError(file, f"stamp {stamp_s:g}; expected a time in seconds", line)
    is_first = np.isin([line for line, _ in all_rows], [line for line, _ in rows])
    ids = np.nan_to_num(all_values[:, -1]).astype(int)
    values = all_values[is_first]
    activation: dict[str, Array] = {}
    if (skin := folder / tables.ACTIVATION).is_file():
        taxels = tables.column_names(skin)[1:]
        activations = _numbers(skin, tables.read_table(skin, taxels), len(taxels))
        if len(activations) != len(rows):
            raise InputError(skin, f"{len(activations)} rows; expected the {len(rows)} of trajectory.csv")
        activation = dict(zip(taxels, activations.T, strict=True))
    true = source / "truth.csv"
    return Tracked(
        stamps_s=values[:, 0],
        position=values[:, 1:4],
        cov=tables.covariances(values[:, 7:13]),
        status=np.array([row[-1] for _, row in rows]),
        paths=_paths(all_values[:, :7], ids, is_first),
        reach=values[:, 13] if with_map else None,
        activation=activation,
        truth=_numbers(true, tables.read_table(true, ["stamp_s", "x_m", "y_m", "z_m"]) if true.is_file() else [], 4),
    )


def _paths(values: Array, ids: NDArray[np.int_], is_first: Mask) -> dict[int, TrackPath]:
    """The paths of known tracks, of rows (r, 7) of stamp, position and velocity; `ids` (r,) their numbers, `is_first`
    (r,) whether a row is the first of its pair."""
    pair = np.cumsum(is_first) - 1
    stamps_s = values[is_first, 0]
    is_known = np.isfinite(values[:, 1:4]).all(axis=1)
    order = np.flatnonzero(is_known)[np.argsort(ids[is_known], kind="stable")]
    paths = {}
    for rows in np.split(order, np.flatnonzero(np.diff(ids[order])) + 1):
        if len(rows):
            begin, n = pair[rows[0]], np.ptp(pair[rows]) + 1
            path = TrackPath(stamps_s[begin : begin + n], np.full((n, 6), np.nan), np.zeros(n, bool))
            path.state[pair[rows] - begin] = values[rows, 1:]
            path.is_attended[pair[rows] - begin] = is_first[rows]
            paths[int(ids[rows[0]])] = path
    return paths


def _numbers(file: Path, rows: Sequence[tuple[int, list[str]]], n: int) -> Array:
    """(rows, n) the first n numbers of each row, NaN for an empty field."""
    return np.reshape([tables.numbers(file, line, row[:n]) for line, row in rows], (len(rows), n))


def _warnings_of(summary: TrackSummary) -> list[str]:
    """Warnings, few measurements, remedies and skipped data."""
    warnings = [*summary["warnings"]]
    frames = summary["frames"]
    share = summary["status"].get("tracking", 0) / frames
    if share < _FEW_TRACKED:
        warnings.append(f"measured in {100 * share:.0f} % of {frames} pairs only")
    if lost := summary["status"].get("lost", 0):
        warnings.append(f"lost {lost} times")
    if "diagnosis" in summary:
        warnings += [f"try {advice}" for advice in summary["diagnosis"]["advice"]]
    warnings += [f"skipped: {n} {kind}" for kind, n in summary["skipped"].items() if n]
    turned = summary["cameras"].get("rotation_deg", 0.0)
    if turned is None:
        warnings.append(UNSEEN)
    elif turned > 1:
        warnings.append(f"cameras that are said to be fixed turned by {turned:.1f}°")
    return warnings


def write_report(folder: Path) -> None:
    """Write report.html into the folder of a tracked recording; InputError if it is none."""
    summary = read_track_summary(folder)
    tracked = _read_tracked(folder, Path(summary["source"]))
    is_finite = np.isfinite(tracked.cov).all(axis=(1, 2)) & np.isfinite(tracked.position).all(axis=1)
    truth = [("#777", tracked.truth[:, 1:])] if len(tracked.truth) else []
    thick = []
    thin = []
    for track_id, track in tracked.paths.items():
        position = track.state[:, :3]
        if track.is_attended.any():
            thick.append((track_hex(track_id), np.where(track.is_attended[:, None], position, np.nan)))
        if np.isfinite(position[~track.is_attended]).any():
            thin.append((track_hex(track_id), position))
    known = tracked.position[is_finite], tracked.cov[is_finite]
    path = path3d([*thick, *thin, *truth] or [("#777", tracked.position)], *known, len(thick))
    header = ["stage", "median", "lower quartile", "upper quartile", "runs"]
    times = [
        [stage, *map(_text, (ms["median_ms"], ms["q25_ms"], ms["q75_ms"], ms["runs"]))]
        for stage, ms in summary["ms_per_pair"].items()
    ]
    shown = ("mode", "seed", "device", "smoothed", "map", "memory")
    settings = {key: value for key, value in summary.items() if key in shown}
    sections = [
        ("Images", "", _images(folder)),
        (
            "Tracks in the images",
            "Centres of the detections, each track in its colour.",
            _image_tracks(folder, tracked),
        ),
        (
            "3D path",
            "Each track in its colour, thick where it is attended, with 95 % ellipsoids; grey: the truth, where it is "
            "known. Drag to turn, wheel to zoom. "
            "Root frame: the robot's, or the left camera's (x right, y down, z ahead).",
            path,
        ),
        (
            "Position, distance and approach",
            "Position of each track, with its own ±2σ where it is attended; distance from the root frame's origin, and "
            "the time until the object would be there at its present speed of approach; with a map, the degree of "
            "reachability of the attended object (reachable from 0.5 on).",
            page.image(_over_time(tracked)),
        ),
        (
            "Activation over the body",
            "For every taxel the probability that what approaches will touch it; above 0.4 the arm moves away.",
            page.image(_over_the_body(tracked)) if tracked.activation else "",
        ),
        ("Numbers", "", _numbers_table(summary)),
        ("Time for each stage of a pair", "Milliseconds on this machine.", page.table(header, times)),
        ("To repeat it", "", _repeat(summary.get("command", ""), settings | summary.get("versions", {}))),
    ]
    warnings = _warnings_of(summary)
    answers = page.fragment(
        _ANSWERS,
        worked=_worked(summary),
        exact=_exact(summary, tracked.cov[is_finite]),
        warnings=page.fragment(_WARNINGS, warnings=warnings) if warnings else _UNNOTICED,
    )
    page.write_page(
        folder, summary["source"], "", answers, [section for section in sections if section[2]], PATH_SCRIPT
    )


def _worked(summary: TrackSummary) -> str:
    """How much was tracked, and what."""
    status = summary["status"]
    parts = [f"{_measured(summary)} ({100 * status.get('tracking', 0) / summary['frames']:.0f} %)"]
    if coasting := status.get("coasting"):
        parts.append(f"{coasting} predicted")
    if len(tracks := summary.get("tracks", ())) > 1:
        parts.append(f"{len(tracks)} tracks")
    if size := summary.get("object"):
        interval = f"{1000 * size['low_95_m']:.3g}–{1000 * size['high_95_m']:.3g}"
        parts.append(f"object {1000 * size['diameter_m']:.3g} mm across (95 %: {interval})")
    return ", ".join(parts)


def _exact(summary: TrackSummary, cov: Array) -> str:
    """True and stated errors, and whether both cameras agree; `cov` (n, 3, 3) of the known positions, m²."""
    parts = []
    if (rms_mm := summary.get("errors", {}).get("position_rms_mm")) is not None:
        parts.append(f"{rms_mm:.3g} mm from the truth (RMS)")
    if len(cov):
        worst_mm = 1960 * np.sqrt(np.median(np.linalg.eigvalsh(cov)[:, -1]))
        parts.append(f"by its own covariance ± {worst_mm:.2g} mm in the most uncertain direction (95 %, median)")
    if (residual_px := summary.get("residual_px")) is not None:
        parts.append(f"both cameras agree within {residual_px:.2g} px (median)")
    return ", ".join(parts) or "No position is known."


def _measured(summary: TrackSummary) -> str:
    return f"{summary['status'].get('tracking', 0)} of {summary['frames']} stereo pairs measured"


def _images(folder: Path) -> Markup:
    """The overlay video, or key frames."""
    film = folder / "overlay.mp4"
    if film.is_file() and film.stat().st_size <= _LARGEST_VIDEO:
        return page.video(film)
    frames = sorted((folder / KEY_FRAMES).glob("*.jpg"))
    return Markup("").join(page.picture(frame.read_bytes(), "jpeg", frame.stem) for frame in frames)


def _image_tracks(folder: Path, tracked: Tracked) -> Markup:
    file = folder / "detections.csv"
    rows = tables.read_table(file, ["u_px", "v_px", "track_id", "camera"])
    if not rows:
        return Markup("<p>Nothing was detected.</p>")
    values = _numbers(file, rows, 3)
    ids = np.nan_to_num(values[:, 2]).astype(int)
    camera = np.array([row[-1] for _, row in rows])
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    for axis, side in zip(figure.subplots(1, 2), ("left", "right"), strict=True):
        for track_id in np.unique(ids).tolist():
            u, v = values[(camera == side) & (ids == track_id), :2].T
            axis.plot(u, v, ".", ms=4, **_style(tracked, track_id))
        axis.set(title=side, xlabel="u (px)", ylabel="v (px)", aspect="equal")
        axis.invert_yaxis()
        if axis.get_legend_handles_labels()[1]:
            axis.legend(fontsize=7)
    return page.image(figure)


def _style(tracked: Tracked, track_id: int) -> dict[str, str]:
    """Colour of a track in a figure, grey if it was never known, and the label of one of the longest tracks."""
    if track_id not in tracked.paths:
        return {"color": "#bbbbbb"}
    longest = sorted(tracked.paths, key=lambda number: -len(tracked.paths[number].stamps_s))[:_MOST_LABELS]
    return {"color": track_hex(track_id)} | ({"label": f"track {track_id}"} if track_id in longest else {})


def _over_time(tracked: Tracked) -> Figure:
    t = tracked.stamps_s - tracked.stamps_s[0]
    more = tracked.reach is not None
    figure = Figure(figsize=(9, 9 + 1.6 * more), layout="constrained")
    axes = figure.subplots(5 + more, 1, sharex=True)
    for k, name in enumerate("xyz"):
        sigma = np.sqrt(tracked.cov[:, k, k])
        p = tracked.position[:, k]
        axes[k].fill_between(t, p - 2 * sigma, p + 2 * sigma, color="0.4", alpha=0.25, lw=0)
        if len(tracked.truth):
            axes[k].plot(tracked.truth[:, 0] - tracked.stamps_s[0], tracked.truth[:, 1 + k], "k:", lw=1)
        axes[k].set_ylabel(f"{name} (m)")
    for track_id, track in tracked.paths.items():
        style = _style(tracked, track_id)
        track_s = track.stamps_s - tracked.stamps_s[0]
        distance, ttc = distance_and_ttc_of_origin(track.state[:, :3], track.state[:, 3:])
        for axis, values in zip(axes, (*track.state[:, :3].T, distance), strict=False):
            axis.plot(track_s, values, lw=1, **style)
        axes[4].plot(track_s, ttc, ".", ms=3, **style)
    axes[3].set_ylabel("distance (m)")
    axes[4].set(ylabel="time to contact (s)", ylim=(0, 5))
    if tracked.paths:
        axes[0].legend(fontsize=7)
    if tracked.reach is not None:
        axes[5].plot(t, tracked.reach, color="0.25", lw=1)
        axes[5].axhline(0.5, color="0.25", lw=1, ls="--")
        axes[5].set(ylabel="degree of reach", ylim=(0, 1))
    for axis in axes:
        axis.grid(alpha=0.25)
        for status, color in _COLORS.items():
            has_status = tracked.status == status
            if status != Status.TRACKING and has_status.any():
                page.shade(axis, t, has_status, color, 0.15)
    axes[-1].set_xlabel("time (s); shaded: searching (grey), predicted (yellow), lost (red)")
    return figure


def _over_the_body(tracked: Tracked) -> Figure:
    """Activation of the taxels over time, one row each, the taxels of a body part together."""
    parts = [name.rpartition(":")[0] for name in tracked.activation]
    figure = Figure(figsize=(9, 1.5 + 0.12 * min(len(parts), 60)), layout="constrained")
    axis = figure.subplots()
    t = tracked.stamps_s - tracked.stamps_s[0]
    activation = np.stack(list(tracked.activation.values()))
    shown = axis.pcolormesh(t, np.arange(len(parts)), activation, vmin=0, vmax=1, cmap="magma", shading="nearest")
    first = [k for k, part in enumerate(parts) if k == 0 or part != parts[k - 1]]
    axis.set_yticks(first, [parts[k] for k in first])
    axis.hlines([k - 0.5 for k in first], *axis.get_xlim(), color="w", lw=0.5)
    axis.invert_yaxis()
    axis.set(xlabel="time (s)")
    figure.colorbar(shown, ax=axis, label="activation")
    return figure


def _numbers_table(summary: TrackSummary) -> Markup:
    rows = [["pairs " + key, _text(value)] for key, value in summary["status"].items()]
    rows += [[key, _text(value)] for key, value in summary.get("errors", {}).items()]
    if len(tracks := summary.get("tracks", [])) > 1:
        for item in tracks:
            pairs = item["tracking"] + item["coasting"]
            rows.append([f"track {item['track_id']}: pairs, attended", f"{pairs}, {item['attended']}"])
    for item in tracks:
        for side, check in item.get("reprojection", {}).items():
            name = f"{item.get('name')}: {side} image, beside the prediction"
            wanted = f"{check['nis_expected']:.0f} expected, outside the 95 % ellipse {_text(check['outside_95'])}"
            rows.append([name, f"{_text(check['median_px'])} px (median), NIS {_text(check['nis'])}, {wanted}"])
        if "outliers" in item:
            rows.append([f"{item.get('name')}: outliers", _text(item["outliers"])])
    rows += [[f"points: {key}", _text(value)] for key, value in summary.get("points", {}).items()]
    rows += [[f"clock: {key}", _text(value)] for key, value in summary.get("clock", {}).items()]
    rows += [["reach: " + key, _text(value)] for key, value in summary.get("reach", {}).items()]
    rows += [["cameras: " + key, _text(value)] for key, value in summary["cameras"].items() if value is not None]
    return page.table(["", "value"], rows)


def _repeat(command: str, settings: Mapping[str, object]) -> Markup:
    rows = [[key, _text(value)] for key, value in settings.items()]
    return page.fragment("<pre>{{ text }}</pre>", text=command) + page.table(["setting or package", "value"], rows)


def write_batch_report(folder: Path) -> None:
    """Write report.html into the folder of a batch: failures, and a row for each recording; InputError if it is
    none."""
    file = folder / BATCH
    columns = tuple(TRACK_TABLE)
    rows = []
    for line, fields in tables.read_table(file, columns, exact=True):
        row = dict(zip(columns, fields, strict=True))
        tables.numbers(file, line, [row[column] for column in columns if TRACK_TABLE[column] is not str])
        rows.append(row)
    failed = [row for row in rows if row["status"] == "failed"]
    warned = [f"{row['name']} failed: {row['reason']}" for row in failed]
    for row in rows:
        if row["status"] != "failed":
            warned += [f"{row['name']}: {text}" for text in _warnings_of(read_track_summary(folder / row["name"]))]
    text = "One dot for each recording, the first on top; a cross: it failed."
    sections = [
        ("Recordings", "", _batch_table(folder, rows, columns)),
        ("Tracked share and time", text, page.image(_batch_figure(rows))),
    ]
    if (file := folder / SUMMARY).is_file():
        batch = read_result(file, BatchSummary, "the summary of a batch")
        settings = {key: value for key, value in batch["settings"].items() if value not in (None, [])}
        settings |= {"started": batch["started"], "seconds": batch["seconds"], **batch["versions"]}
        sections.append(("To repeat it", "", _repeat(batch["command"], settings)))
    lead = f"{len(rows) - len(failed)} of {len(rows)} tracked"
    page.write_page(folder, f"Batch {folder.name}", lead, page.fragment(_WARNINGS, warnings=warned), sections)


def _batch_figure(rows: Sequence[Mapping[str, str]]) -> Figure:
    """Tracked share and time a pair of every recording."""
    figure = Figure(figsize=(9, 1.2 + 0.22 * min(len(rows), _MOST_NAMES)), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    for axis, column, scale in zip(axes, ("tracked_share", "ms_per_pair"), (100, 1), strict=True):
        points = [(scale * float(row[column]), k) for k, row in enumerate(rows) if row[column]]
        axis.plot(*np.reshape(points, (-1, 2)).T, "o", ms=4, color="tab:blue")
        if failed := [k for k, row in enumerate(rows) if row["status"] == "failed"]:
            axis.plot(np.zeros(len(failed)), failed, "x", ms=5, color=_COLORS[Status.LOST], clip_on=False)
        axis.grid(alpha=0.25)
    axes[0].set(xlabel="pairs tracked (%)", xlim=(0, 103), ylim=(len(rows) - 0.5, -0.5))
    axes[1].set(xlabel="time a pair (ms)", xlim=(0, None))
    if len(rows) <= _MOST_NAMES:
        axes[0].set_yticks(range(len(rows)), [_drawable(row["name"]) for row in rows], fontsize=8, parse_math=False)
    return figure


def _batch_table(folder: Path, rows: Sequence[Mapping[str, str]], columns: Sequence[str]) -> Markup:
    def cells(row: Mapping[str, str]) -> Iterator[str]:
        name = row["name"]
        yield page.link(name, name, REPORT) if (folder / name / REPORT).is_file() else name
        for column in columns[1:]:
            is_number = TRACK_TABLE[column] is not str and row[column]
            yield f"{float(row[column]):.4g}" if is_number else row[column]

    return page.table(columns, map(cells, rows))


def _drawable(name: str) -> str:
    """A name whose unprintable characters are escaped."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in name)


def _text(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else "–" if value is None else str(value)

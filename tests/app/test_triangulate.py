"""Points of other detectors become 3D paths: tables in every form, honest covariances, outliers, jumps, files."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from calibrations import store
from flat_patterns import SIZE, K, R, T

import pps_vision as pv
from pps_vision.app.cli import main

N, FPS = 60, 30
D = (np.array([-0.1, 0.03, 0.001, -0.001, 0.0]), np.array([-0.12, 0.02, 0.0, 0.001, 0.0]))
CHI2_95 = 7.815
NAMES = ("nose", "tail")
Pixels = np.ndarray  # (2 cameras, n, names, 2)


def paths(n: int = N, seed: int = 0, fps: float = FPS) -> np.ndarray:
    """(n, 2 names, 3) m: smooth paths within the view of both cameras."""
    rng = np.random.default_rng(seed)
    t = np.arange(n)[:, None, None] / fps
    waves = [0.05 * np.sin(2 * np.pi * (rng.uniform(0.1, 0.7, (1, 2, 3)) * t + rng.random((1, 2, 3)))) for _ in "ab"]
    return sum(waves) + np.array([[[0.0, 0.0, 0.8], [0.1, 0.05, 0.9]]])


def seen(points: np.ndarray, R: np.ndarray = R, T: np.ndarray = T) -> Pixels:
    """Pixels (2, n, names, 2) of points (n, names, 3) in the left camera's frame, by OpenCV."""
    flat = np.ascontiguousarray(points.reshape(-1, 3))
    cameras = [(np.eye(3), np.zeros(3)), (R, T)]
    sides = [cv2.projectPoints(flat, cv2.Rodrigues(turn)[0], t, K[k], D[k])[0] for k, (turn, t) in enumerate(cameras)]
    return np.array(sides).reshape(2, *points.shape[:2], 2)


@pytest.fixture
def calib(tmp_path: Path) -> Path:
    size = {"image_width": SIZE[0], "image_height": SIZE[1]}
    return store(tmp_path / "calibration.yml", K1=K[0], D1=D[0], K2=K[1], D2=D[1], R=R, T=T, **size)


def deeplabcut(file: Path, pixels: np.ndarray, individuals: tuple[str, ...] = ()) -> None:
    rows = [["scorer", *["DLC"] * 6]]
    if individuals:
        rows.append(["individuals", *[individuals[0]] * 3, *[individuals[1]] * 3])
    parts = ["nose", "nose"] if individuals else list(NAMES)
    rows += [["bodyparts", *[parts[0]] * 3, *[parts[1]] * 3], ["coords", *["x", "y", "likelihood"] * 2]]
    rows += [[k, *pixels[k, 0], 0.99, *pixels[k, 1], 0.98] for k in range(len(pixels))]
    file.write_text("".join(",".join(map(str, row)) + "\n" for row in rows))


def labelled(file: Path, pixels: np.ndarray) -> None:
    """DeepLabCut's table of labelled images, which are named in three columns; an unlabelled point is empty."""
    head = "scorer,,,me,me,me,me\nbodyparts,,,nose,nose,tail,tail\ncoords,,,x,y,x,y\n"
    rows = [f"labeled-data,film,img{k:04d}.png,{','.join(map(str, p.ravel()))}\n" for k, p in enumerate(pixels)]
    rows[7] = f"labeled-data,film,img0007.png,,,{pixels[7, 1, 0]},{pixels[7, 1, 1]}\n"
    file.write_text(head + "".join(rows))


def wide(file: Path, pixels: np.ndarray) -> None:
    head = "nose_x,nose_y,nose_score,tail_x,tail_y,tail_score,fnum\n"
    rows = [f"{a[0]},{a[1]},0.9,{b[0]},{b[1]},0.8,{k}\n" for k, (a, b) in enumerate(pixels)]
    file.write_text(head + "".join(rows))


def sleap(file: Path, pixels: np.ndarray) -> None:
    head = "track,frame_idx,instance.score,nose.x,nose.y,nose.score,tail.x,tail.y,tail.score\n"
    rows = [f"mouse,{k},0.9,{a[0]},{a[1]},0.9,{b[0]},{b[1]},0.8\n" for k, (a, b) in enumerate(pixels)]
    file.write_text(head + "".join(rows))


def rows_of_points(file: Path, pixels: np.ndarray) -> None:
    rows = [
        f"{k / FPS!r},{name},{p[0]},{p[1]},0.5,0.1,0.5\n"
        for k, pair in enumerate(pixels)
        for name, p in zip(NAMES, pair, strict=True)
    ]
    file.write_text("stamp_s,name,u_px,v_px,cov_uu_px2,cov_uv_px2,cov_vv_px2\n" + "".join(rows))


def coco(file: Path, pixels: np.ndarray) -> None:
    images = [{"id": 100 + k, "file_name": f"cam/{k:05d}.png"} for k in range(len(pixels))]
    annotations = [
        {"id": k, "image_id": 100 + k, "category_id": 1, "keypoints": [*a.tolist(), 2, *b.tolist(), 1]}
        for k, (a, b) in enumerate(pixels)
    ]
    categories = [{"id": 1, "name": "mouse", "keypoints": list(NAMES)}]
    file.write_text(json.dumps({"images": images, "annotations": annotations, "categories": categories}))


def mot(file: Path, pixels: np.ndarray) -> None:
    """Boxes of 9 × 5 pixels around the points; frames and pixels count from 1."""
    rows = [
        f"{k + 1},{i + 1},{u + 1 - 4},{v + 1 - 2},9,5,0.9,-1,-1,-1\n"
        for k, pair in enumerate(pixels)
        for i, (u, v) in enumerate(pair)
    ]
    file.write_text("".join(rows))


FORMS: dict[str, tuple[Callable[[Path, np.ndarray], None], tuple[str, str]]] = {
    "deeplabcut.csv": (deeplabcut, NAMES),
    "individuals.csv": (lambda file, p: deeplabcut(file, p, ("a", "b")), ("a:nose", "b:nose")),
    "labelled.csv": (labelled, NAMES),
    "wide.csv": (wide, NAMES),
    "sleap.csv": (sleap, NAMES),
    "points.csv": (rows_of_points, NAMES),
    "coco.json": (coco, NAMES),
    "mot.txt": (mot, ("1", "2")),
}


@pytest.mark.parametrize("form", FORMS)
def test_a_table_of_every_form(form, tmp_path, calib):
    truth = paths()
    write, names = FORMS[form]
    files = [tmp_path / f"{side}_{form}" for side in ("left", "right")]
    for file, pixels in zip(files, seen(truth), strict=True):
        write(file, pixels)
    run = pv.triangulate(*files, calib=calib, fps=FPS)
    assert run.names == names
    np.testing.assert_allclose(run.stamps_s, np.arange(N) / FPS, atol=1e-9)
    for k, name in enumerate(names):
        path = run.arrays(name)
        measured = path.status == "tracking"
        assert measured.sum() >= N - 1
        assert np.abs(path.position - truth[:, k])[measured].max() < 1e-4
    velocity = run.arrays(smooth=True).velocity
    np.testing.assert_allclose(velocity[5:-5], np.gradient(truth[:, 0], 1 / FPS, axis=0)[5:-5], atol=0.01)


def test_sleaps_analysis_file(tmp_path, calib):
    h5py = pytest.importorskip("h5py")
    truth = paths()
    for side, pixels in zip("lr", seen(truth), strict=True):
        with h5py.File(tmp_path / side, "w") as file:
            file["tracks"] = pixels.transpose(2, 1, 0)[None]  # (tracks, 2, nodes, frames)
            file["node_names"] = [name.encode() for name in NAMES]
            file["point_scores"] = np.full((1, 2, N), 0.9)
    path = pv.triangulate(tmp_path / "l", tmp_path / "r", calib=calib, fps=FPS).arrays("tail")
    assert np.abs(path.position - truth[:, 1]).max() < 1e-4


def test_deeplabcuts_h5_holds_pickles_and_is_refused_with_a_way_out(tmp_path, calib):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "l.h5", "w") as file:  # as pandas writes it
        rows = np.zeros(3, [("index", "<i8"), ("values_block_0", "<f8", (6,))])
        file.create_group("df_with_missing").create_dataset("table", data=rows)
    with pytest.raises(pv.InputError, match="analyze_videos_converth5_to_csv"):
        pv.triangulate(tmp_path / "l.h5", tmp_path / "l.h5", calib=calib, fps=FPS)


def noisy(tmp_path: Path, kind: str, n: int = 500, seed: int = 5) -> tuple[list[Path], np.ndarray]:
    """Tables of points with errors of 0.5 px, 10 % of them outliers, and their truth."""
    rng = np.random.default_rng(seed)
    truth = paths(n, seed)
    pixels = seen(truth)
    score = rng.beta(5, 2, pixels.shape[:3])
    error = rng.normal(0, 0.5, pixels.shape)
    outlier = rng.random(pixels.shape[:3]) < 0.1
    if kind == "heavy tails":
        error = 0.5 * rng.standard_t(3, pixels.shape)
    elif kind == "likelihood tells":
        error *= (4 * (1.05 - score))[..., None]
    elif kind == "likelihood lies":
        error *= (4 * (0.05 + score))[..., None]
        score[outlier] = 0.99
    error[outlier] = rng.uniform(-80, 80, (outlier.sum(), 2))
    files = [tmp_path / f"{side}.csv" for side in ("left", "right")]
    for file, side, scores in zip(files, pixels + error, score, strict=True):
        rows = [
            f"{k},{name},{u},{v},{p}\n"
            for k in range(n)
            for name, (u, v), p in zip(NAMES, side[k], scores[k], strict=True)
        ]
        file.write_text("frame,name,u,v,likelihood\n" + "".join(rows))
    return files, truth


@pytest.mark.parametrize("kind", ["outliers", "heavy tails", "likelihood tells", "likelihood lies"])
def test_the_stated_ellipsoids_hold_the_truth(kind, tmp_path, calib):
    files, truth = noisy(tmp_path, kind)
    run = pv.triangulate(*files, calib=calib, fps=FPS)
    for smooth in (False, True):
        inside = []
        errors = []
        for k, name in enumerate(NAMES):
            path = run.arrays(name, smooth)
            known = np.isfinite(path.position[:, 0])
            assert known.mean() > 0.98
            error = (path.position - truth[:, k])[known]
            inside.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(path.cov[known, :3, :3]), error) < CHI2_95)
            errors.append(np.linalg.norm(error, axis=1))
        assert 0.88 < np.mean(np.concatenate(inside)) < 0.995
        assert np.median(np.concatenate(errors)) < 0.02
    for item in run.numbers:
        if kind != "likelihood lies":  # in the group of the best score half of the pairs are outliers: it is very noisy
            assert 0.1 < item["outliers"] / len(run.stamps_s) < 0.25  # 19 % of the pairs have an outlier
        for check in item["reprojection"].values():
            assert 1.4 < check["nis"] < 3.5
    if kind == "likelihood tells":
        assert run.noise.std[0] > 1.5 * run.noise.std[-1]


def test_a_point_between_cameras_that_face_each_other(tmp_path):
    """It is as far from both as their midpoint is, not as from that."""
    turn = cv2.Rodrigues(np.array([0.0, np.deg2rad(170), 0.0]))[0]
    shift = -turn @ np.array([0.15, 0.0, 1.6])
    size = {"image_width": SIZE[0], "image_height": SIZE[1]}
    calib = store(tmp_path / "facing.yml", K1=K[0], D1=D[0], K2=K[1], D2=D[1], R=turn, T=shift, **size)
    truth = paths(200)
    pixels = seen(truth, turn, shift) + np.random.default_rng(0).normal(0, 0.3, (2, 200, 2, 2))
    files = [tmp_path / f"{side}.csv" for side in ("left", "right")]
    for file, side in zip(files, pixels, strict=True):
        wide(file, side)
    path = pv.triangulate(*files, calib=calib, fps=FPS).arrays()
    error = np.hstack([path.position - truth[:, 0], path.velocity - np.gradient(truth[:, 0], 1 / FPS, axis=0)])[10:]
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(path.cov[10:]), error)
    assert 4 < np.mean(nees) < 7  # 6 are expected; 8.5 by the distance from the midpoint


def test_a_bounce_is_no_outlier(tmp_path, calib):
    """Positions on a path with corners, almost without noise."""
    t = np.arange(N) / FPS
    truth = np.stack([0.3 * t - 0.3, 0.1 - np.abs((t % 0.5) - 0.25), np.full(N, 0.8)], axis=1)[:, None]
    pixels = seen(truth) + np.random.default_rng(0).normal(0, 0.02, (2, N, 1, 2))
    files = [tmp_path / f"{side}.csv" for side in ("left", "right")]
    for file, side in zip(files, pixels, strict=True):
        file.write_text("frame,u,v\n" + "".join(f"{k},{u},{v}\n" for k, (u, v) in enumerate(side[:, 0])))
    run = pv.triangulate(*files, calib=calib, fps=FPS)
    assert np.linalg.norm(run.arrays().position - truth[:, 0], axis=1).max() < 0.003
    assert run.numbers[0]["outliers"] == 0


def test_images_are_paired_by_stamp_and_gaps_stay_open(tmp_path, calib):
    truth = paths()
    left, right = seen(truth)[:, :, 0]
    rows = [f"{1000 * k / FPS:.4f},{u},{v}\n" for k, (u, v) in enumerate(left) if not 20 <= k < 40]
    (tmp_path / "l.csv").write_text("time_ms,x,y\n" + "".join(rows))
    rows = [f"{k / FPS + 0.004!r},{u},{v}\n" for k, (u, v) in enumerate(right) if k != 5]
    (tmp_path / "r.csv").write_text("stamp_s,x,y\n" + "".join(rows))
    run = pv.triangulate(tmp_path / "l.csv", tmp_path / "r.csv", calib=calib)
    assert len(run.stamps_s) == N - 21
    assert {problem.file.name: problem.count for problem in run.problems} == {"l.csv": 1, "r.csv": 20}
    status = run.arrays().status
    assert status[18] == status[20] == "tracking"  # it starts anew after the gap of 0.7 s


def late(tmp_path: Path, delay_s: float, seed: int, still: bool = False) -> tuple[list[Path], np.ndarray]:
    """Tables whose right stamps are late and lie between the left ones; errors of 0.3 px."""
    rng = np.random.default_rng(seed)
    dense = paths(3001, seed, 10 * FPS)[:, :1] if not still else np.tile([[[0.1, 0.1, 0.9]]], (3001, 1, 1))
    files = [tmp_path / f"late_{side}.csv" for side in ("left", "right")]
    for file, pixels, first, shift in zip(files, seen(dense)[:, :, 0], (0, 4), (0.0, delay_s), strict=True):
        stamps = np.arange(len(dense))[first::10] / (10 * FPS) + shift
        noisy = pixels[first::10] + rng.normal(0, 0.3, pixels[first::10].shape)
        lines = [f"{t!r},{u!r},{v!r}\n" for t, (u, v) in zip(stamps.tolist(), noisy.tolist(), strict=True)]
        file.write_text("stamp_s,u,v\n" + "".join(lines))
    return files, dense[::10, 0]


def test_a_late_camera_is_found_and_corrected(tmp_path, calib, capsys):
    for seed, delay_s in enumerate((0.137, -0.42)):
        files, truth = late(tmp_path, delay_s, seed)
        run = pv.triangulate(*files, calib=calib, clock="auto")
        assert run.clock.is_late
        assert abs(run.clock.delay_s - delay_s) < min(4 * run.clock.std_s, 0.001)
        path = run.arrays(smooth=True)
        known = np.isfinite(path.position[:, 0])
        assert known.mean() > 0.8
        rows = np.rint(path.stamps_s * FPS).astype(int)
        assert np.median(np.linalg.norm(path.position - truth[rows], axis=1)[known]) < 0.003
    files, _ = late(tmp_path, 0.137, 0, still=True)
    main(["triangulate", *map(str, files), "--calib", str(calib), "--clock", "auto", "--out", str(tmp_path / "still")])
    assert "unobservable, nothing moves across the epipolar lines" in capsys.readouterr().out
    clock = json.loads((tmp_path / "still" / "summary.json").read_text())["clock"]
    assert clock["corrected"] is False
    main(["report", str(tmp_path / "still")])


def test_the_command_writes_what_track_writes(tmp_path, calib, capsys):
    files, truth = noisy(tmp_path, "outliers", 120)
    out = tmp_path / "out"
    words = ["triangulate", *map(str, files), "--calib", str(calib), "--fps", str(FPS), "--points", "tail", "nose"]
    main([*words, "--smooth", "--report", "--also", "tum", "anipose", "--out", str(out)])
    assert "240 pairs" not in capsys.readouterr().out
    table = np.genfromtxt(out / "trajectory.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert table["name"].tolist()[:2] == ["tail", "nose"]
    tail = table[table["name"] == "tail"]
    assert np.median(np.abs(tail["z_m"] - truth[:, 1, 2])) < 0.005
    summary = json.loads((out / "summary.json").read_text())
    assert summary["points"]["std"][0] == pytest.approx(0.5, rel=0.3)
    assert [item["name"] for item in summary["tracks"]] == ["tail", "nose"]
    assert "NIS" in (out / "report.html").read_text()
    assert len((out / "trajectory_2.tum").read_text().splitlines()) > 110
    header = (out / "trajectory_anipose.csv").read_text().split("\n")[0]
    assert header.startswith("tail_x,")
    assert "nose_score" in header
    main(["report", str(out)])
    main(["evaluate", str(out / "trajectory_2.tum"), str(out / "trajectory_2.tum")])
    main(["triangulate", *[str(out / "detections.csv")] * 2, "--calib", str(calib), "--out", str(tmp_path / "again")])


def test_probable_mistakes_are_warned_of(tmp_path, calib):
    """Points of larger images, a calibration in mm, and a rate beside stamps; points as they should be warn of none."""
    pixels = seen(paths()) + np.random.default_rng(0).normal(0, 0.3, (2, N, 2, 2))
    for side, points in zip("lr", pixels, strict=True):
        rows_of_points(tmp_path / f"{side}.csv", points)
        wide(tmp_path / f"{side}_large.csv", 2 * points)
    size = {"image_width": SIZE[0], "image_height": SIZE[1]}
    in_mm = store(tmp_path / "mm.yml", K1=K[0], D1=D[0], K2=K[1], D2=D[1], R=R, T=1000 * T, **size)
    tables = tmp_path / "l.csv", tmp_path / "r.csv"
    run = pv.triangulate(*tables, calib=calib, points="tail")
    assert (run.names, run.warnings) == (("tail",), [])
    assert pv.triangulate(*tables, calib=in_mm, unit_m=0.001).warnings == []
    (apart,) = pv.triangulate(*tables, calib=in_mm).warnings
    assert "the cameras are 120.1 m apart; --unit-m 0.001 makes it 120.1 mm" in apart
    assert "--fps not used: " in pv.triangulate(*tables, calib=calib, fps=15).warnings[0]
    large = pv.triangulate(tmp_path / "l_large.csv", tmp_path / "r_large.csv", calib=calib, fps=FPS)
    assert "l_large.csv are outside the image of 640×480 pixels" in large.warnings[0]


@pytest.mark.parametrize(
    ("left", "options", "message"),
    [
        ("frame,u,v\n0,1,2\n", {}, "has frames, no stamps; expected --fps RATE or --times FILE"),
        ("frame,u,v\n0,1,2\n0,3,4\n", {"fps": 30}, "l.csv:3: point object twice at frame 0"),
        ("frame,u,v\n0,1,a\n", {"fps": 30}, "l.csv:2: could not convert string to float: 'a'"),
        ("frame,u\n0,1\n", {"fps": 30}, "columns frame, u; expected a table of DeepLabCut"),
        ("frame,nose_x,nose_y,nose_z\n0,1,1,1\n", {"fps": 30}, "in 3D already"),
        ("frame,name,u,v\n0,b,1,1\n0,c,1,1\n", {"fps": 30}, "expected a name that both have"),
        ("frame,u,v\n9,1,2\n", {"fps": 30}, "expected the same frames or stamps in both"),
        ("frame,u,v\n0,1,2\n", {"fps": 30, "points": ["x"]}, "no point x; expected one of object"),
        ("scorer,m,m\nbodyparts,a,a\n0,1,2\n", {"fps": 30}, "no header rows bodyparts and coords"),
        ("\x89HDF\r\n\x1a\n", {"fps": 30}, "l.csv: "),
        ("1,1,5,5,9,5\n2\n", {"fps": 30}, "l.csv:2: frame 2, id nan; expected whole numbers"),
        ("{}", {"fps": 30}, "expected COCO's images and annotations"),
        ("0,1,5,5,9,5\n", {"fps": 30}, "l.csv:1: frame 0, id 1; expected whole numbers, frames from 1"),
        ("frame,u,v\n0,0.2,0.3\n1,1,0.5\n", {"fps": 30}, "l.csv: all pixels are from 0 to 1; expected pixels, not"),
        ("frame,u,v\n0,1,2\n", {"fps": np.inf}, "--fps inf, 0 files of --times; expected a positive rate"),
    ],
)
def test_bad_input_is_named(left, options, message, tmp_path, calib):
    (tmp_path / "l.csv").write_bytes(left.encode("latin-1"))
    (tmp_path / "r.csv").write_text("frame,u,v\n0,1,2\n")
    with pytest.raises(pv.InputError) as raised:
        pv.triangulate(tmp_path / "l.csv", tmp_path / "r.csv", calib=calib, **options)
    assert message in str(raised.value)

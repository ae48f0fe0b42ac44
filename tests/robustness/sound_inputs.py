"""A small sound input for every reader, and what reading it means: what tests/robustness/test_readers.py mutates."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copytree
from tempfile import TemporaryDirectory
from typing import Literal

import cv2
import numpy as np
import trimesh
from bags import BagWriter
from calibration_forms import FORMS, SIZE
from recorded import START_S, as_dumped, write_recording
from results import write_results
from videos import encode

from learning.pps.memory import MemoryParams, PPSMemory, activation, load_memory, save_memory
from learning.reach.labels import Labels
from learning.reach.map import ReachableMap
from pps_vision.app.batch import TRACK_TABLE, Task, jobs_of, run_batch
from pps_vision.app.convert_taxels import from_maps
from pps_vision.app.evaluate import evaluate, read_path
from pps_vision.app.evaluate_boxes import evaluate_boxes, read_boxes
from pps_vision.app.report.tracking import report_folder
from pps_vision.app.versions import versions
from pps_vision.errors import InputError
from pps_vision.recordings import CalibrationOptions
from pps_vision.recordings.atomic_write import write_json
from pps_vision.recordings.icub_eyes import read_icub_eyes
from pps_vision.recordings.image_file import ImageFile, decode
from pps_vision.recordings.open import open_recording
from pps_vision.recordings.robot_file import read_robot
from pps_vision.recordings.stereo_calibration import read_stereo_calibration
from pps_vision.recordings.tables import read_gaze, read_joint_offsets, read_truth, write_joint_offsets, write_table
from pps_vision.recordings.taxels_ini import PartMap, read_taxels, write_taxels
from pps_vision.recordings.times import read_times
from pps_vision.recordings.video import open_video
from pps_vision.recordings.warnings import Problem
from pps_vision.robot.gaze import GazeLimits
from pps_vision.robot.icub import icub_setup, load_icub
from pps_vision.robot.robot_setup import RobotSetup
from pps_vision.robot.skin import icub_skin
from rendering.stimulus_file import load_stimulus


@dataclass(frozen=True)
class Reader:
    """A reader with a sound input to mutate."""

    write: Callable[[Path], Sequence[Path]]
    """Writes the sound input into an empty folder; returns the files to mutate."""
    read: Callable[[Path], object]
    """Reads the input from the folder and uses what was read."""


def _recording(folder: Path) -> list[Path]:
    write_recording(folder / "rec")
    return sorted(file for file in (folder / "rec").rglob("*") if file.is_file())


def _read_frames(folder: Path, robot: RobotSetup | None = None) -> None:
    for frame in (recording := open_recording(folder, robot=robot)):
        if recording.rig is not None:
            recording.rig.view_of(frame)


def _read_recording(folder: Path) -> None:
    _read_frames(folder / "rec")


def _dumped_videos(folder: Path) -> list[Path]:
    """The recording with a video in the place of each eye's images, as yarpdatadumper writes it."""
    _recording(folder)
    as_dumped(folder / "rec", "mkv")
    logs = sorted((folder / "rec/cam").rglob("data.log"))
    return [*logs, *(log.with_name("video.mkv") for log in logs)]


def _skin(folder: Path) -> list[Path]:
    _recording(folder)
    contact = "((0 3 4 2) (0.1 -0.02 0.0) (0 0 0) (0 0 0) (0 0 0) (1 0 0) (1 5 9) 10.0)"
    log = folder / "rec/skin/data.log"
    log.write_text("".join(f"{i} {START_S + 0.05 * i} {i * contact}\n" for i in range(4)))
    return [log, *_taxels(folder)]


def _read_skin(folder: Path) -> None:
    open_recording(folder / "rec", taxels=folder / "taxels.ini")


def _taxels(folder: Path) -> list[Path]:
    counts = {3: np.arange(64).reshape(8, 4, 2), 15: np.ones((8, 4, 2), np.int64)}
    form = (-0.1, 0.2, 0.0, 3.0), (8, 4), (3, 3, 15, -1, 3, 15), counts
    write_taxels(folder / "taxels.ini", [PartMap("l_forearm", *form), PartMap("r_hand", *form)])
    return [folder / "taxels.ini"]


def _read_taxels(folder: Path) -> None:
    file = folder / "taxels.ini"
    _use_memory(from_maps(read_taxels(file), file))


def _use_memory(memory: PPSMemory) -> None:
    """Look up activations, which must be probabilities."""
    (d0, d1) = memory.params.distance_range_m
    (t0, t1) = memory.params.ttc_range_s
    n = len(memory.taxel_ids)
    for share in (0.0, 0.3, 1.0):
        d, t = (0.0 if not np.isfinite(a + b) else a + share * (b - a) for a, b in ((d0, d1), (t0, t1)))
        values = activation(memory, np.full(n, d), np.full(n, t))
        if not np.all((values >= 0) & (values <= 1 + 1e-9)):
            raise ArithmeticError(f"activation {values}")


def _offsets(folder: Path) -> list[Path]:
    names = load_icub().joint_names
    write_joint_offsets(folder / "joints.csv", names, np.linspace(-0.1, 0.1, len(names)))
    return [folder / "joints.csv"]


def _gaze(folder: Path) -> list[Path]:
    (folder / "gaze.csv").write_text("name,yaw_deg,pitch_deg,vergence_deg\n" + "a,1.5,-2.25,20\nb,nan,0,10\n" * 4)
    return [folder / "gaze.csv"]


def _of_recording(name: str) -> Callable[[Path], list[Path]]:
    return lambda folder: [file for file in _recording(folder) if file.name == name]


def _calibration(form: str) -> Reader:
    return Reader(FORMS[form], lambda folder: read_stereo_calibration(sorted(folder.iterdir()), SIZE))


_KITTI = "".join(f"P{k}: 30 0 12 {-22 * k} 0 30 8 0 0 0 1 0\n" for k in range(4))


def _kitti_calibration(folder: Path) -> list[Path]:
    (folder / "calib.txt").write_text(_KITTI)
    return [folder / "calib.txt"]


def _read_kitti_calibration(folder: Path) -> None:
    read_stereo_calibration([folder / "calib.txt"], (24, 16), CalibrationOptions(cameras=("image_0", "image_1")))


def _write_images(folder: Path, names: Sequence[str]) -> None:
    folder.mkdir(parents=True)
    for k, name in enumerate(names):
        pixels = np.random.default_rng(k).integers(0, 256, (16, 24, 3), dtype=np.uint8)
        cv2.imwrite(str(folder / name), pixels)


def _euroc(folder: Path) -> list[Path]:
    stamps = [1403636579763555584 + 50_000_000 * k for k in range(4)]
    for camera, calibration in zip(("cam0", "cam1"), FORMS["euroc"](folder), strict=True):
        place = folder / "mav0" / camera
        _write_images(place / "data", [f"{stamp}.png" for stamp in stamps])
        rows = "".join(f"{stamp},{stamp}.png\n" for stamp in stamps)
        (place / "data.csv").write_text("#timestamp [ns],filename\n" + rows)
        (place / "sensor.yaml").write_text(calibration.read_text().replace("[1280, 720]", "[24, 16]"))
        calibration.unlink()
    return sorted(file for file in folder.rglob("*") if file.is_file())


def _kitti(folder: Path) -> list[Path]:
    for camera in ("image_0", "image_1"):
        _write_images(folder / camera, [f"{k:06d}.png" for k in range(4)])
    (folder / "times.txt").write_text("".join(f"{0.1 * k:e}\n" for k in range(4)))
    _kitti_calibration(folder)
    return sorted(file for file in folder.rglob("*") if file.is_file())


_JOINT = """<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="0 0 0.3"/>
  <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
"""


def _robot(folder: Path) -> list[Path]:
    links = "".join(
        f'<link name="{name}"><visual><geometry><sphere radius="0.04"/></geometry></visual></link>\n'
        for name in ("base", "upper", "palm")
    )
    joints = _JOINT.format("a1", "base", "upper") + _JOINT.format("a2", "upper", "palm")
    (folder / "arm.urdf").write_text(f'<robot name="arm">\n{links}{joints}</robot>\n')
    (folder / "skin.csv").write_text(
        "part,frame,taxel,x_m,y_m,z_m,nx,ny,nz\n" + "".join(f"arm,upper,{k},0.04,0,0.0{k},1,0,0\n" for k in range(4))
    )
    (folder / "robot.toml").write_text(
        'urdf = "arm.urdf"\nskin = "skin.csv"\nroot = "base"\nright_arm = ["a1", "a2"]\nright_palm = "palm"\n'
        'left_eye = {link = "base", xyz_m = [0.3, 0.5, 0.7], rpy_deg = [-113.7, 0, 180]}\n'
        'right_eye = "base"\n[home_deg]\na2 = 40\n[ports]\njoints = ["a1", "-", "a2"]\n'
    )
    return sorted(folder.iterdir())


def _read_robot(folder: Path) -> None:
    setup = read_robot(folder / "robot.toml")
    setup.skin.at(setup.robot.at(setup.home_rad))


def _against_itself(text: str, judge: Callable[[Path, Path], object]) -> Reader:
    """A file that is mutated and compared with the sound one."""

    def write(folder: Path) -> list[Path]:
        for name in ("mutant", "sound"):
            (folder / name).write_text(text)
        return [folder / "mutant"]

    def read(folder: Path) -> None:
        with np.errstate(all="ignore"):
            judge(folder / "mutant", folder / "sound")

    return Reader(write, read)


def _path(form: str) -> Reader:
    """A path of ten positions in a form that `evaluate` reads."""
    rows = [(0.1 * k, 0.01 * k, -0.02, 0.5 + 1e-3 * k**2) for k in range(10)]
    if form == "tum":
        text = "# stamp x y z qx qy qz qw\n" + "".join(f"{t} {x} {y} {z} 0 0 0 1\n" for t, x, y, z in rows)
    elif form == "anipose":
        text = "a_x,a_y,a_z,fnum\n" + "".join(f"{x},{y},{z},{k}\n" for k, (_, x, y, z) in enumerate(rows))
    else:
        covariance = ",".join(f"cov_{axes}_m2" for axes in ("xx", "xy", "xz", "yy", "yz", "zz"))
        text = f"stamp_s,x_m,y_m,z_m,{covariance}\n"
        text += "".join(f"{t},{x},{y},{z},1e-6,0,0,1e-6,0,4e-6\n" for t, x, y, z in rows)
    return _against_itself(text, lambda *files: evaluate(*(read_path(file, fps=10.0) for file in files)))


def _boxes(form: str) -> Reader:
    """Boxes in a form that `evaluate --boxes` reads."""
    boxes = [(10 + k, 20 - k, 30.5, 40) for k in range(8)]
    if form == "ours":
        text = "frame,x,y,w,h,score\n" + "".join(
            f"{k},{x},{y},{w},{h},0.9\n" for k, (x, y, w, h) in enumerate(boxes, 1)
        )
    elif form == "mot":
        text = "".join(f"{k},1,{x},{y},{w},{h},1,-1,-1,-1\n" for k, (x, y, w, h) in enumerate(boxes, 1))
    else:
        text = "".join(f"{x}\t{y}\t{w}\t{h}\n" for x, y, w, h in boxes)
    return _against_itself(text, lambda *files: evaluate_boxes(*map(read_boxes, files)))


def _manifest(folder: Path) -> list[Path]:
    rows = "first,l.mp4,r.mp4,camchain.yaml,\nsecond,seq/left,seq/right,left.yaml;right.yaml,30\n"
    (folder / "list.csv").write_text("name,left,right,calib,fps\n" + rows)
    return [folder / "list.csv"]


def _image(suffix: str) -> Reader:
    def write(folder: Path) -> list[Path]:
        pixels = np.random.default_rng(0).integers(0, 256, (24, 32, 3), dtype=np.uint8)
        cv2.imwrite(str(folder / f"image.{suffix}"), pixels)
        return [folder / f"image.{suffix}"]

    return Reader(write, _read_image)


def _read_image(folder: Path) -> None:
    (file,) = folder.iterdir()
    image = decode(ImageFile(file, 0.0))
    if isinstance(image, Problem):
        raise InputError(file, image.message)


def _video(suffix: str, codec: str) -> Reader:
    def write(folder: Path) -> list[Path]:
        images = np.random.default_rng(0).integers(0, 256, (5, 24, 32, 3), dtype=np.uint8)
        return [encode(folder / f"video.{suffix}", images, 20, codec=codec)]

    return Reader(write, lambda folder: [frame.load() for frame in open_video(next(folder.iterdir()), None)])


def _bag(storage: Literal["ros1", "sqlite3", "mcap"]) -> Reader:
    """A bag with two topics of images, raw and compressed, their calibration and joints."""
    name = "bag.bag" if storage == "ros1" else "bag"

    def write(folder: Path) -> list[Path]:
        robot = icub_setup().robot
        P = np.array([[30.0, 0, 11.5, 0], [0, 30, 7.5, 0], [0, 0, 1, 0]])
        pixels = np.random.default_rng(0).integers(0, 256, (16, 24, 3), dtype=np.uint8)
        with BagWriter(folder / name, storage) as bag:
            for side, shift_px in (("left", 0.0), ("right", 3.6)):
                bag.write(f"/{side}/camera_info", bag.camera_info(P - shift_px * np.eye(3, 4, 3), (24, 16)), 0.0)
            for k in range(4):
                at = 10 + 0.05 * k
                bag.write("/joint_states", bag.joints(robot.joint_names, np.zeros(robot.n_joints), at), at)
                bag.write("/left/image", bag.image(pixels, "bgr8", at), at)
                bag.write("/right/image", bag.png(pixels, at), at)
        return [bag.path] if bag.path.is_file() else sorted(bag.path.iterdir())

    def read(folder: Path) -> None:
        for robot in (None, icub_setup()):
            _read_frames(folder / name, robot)

    return Reader(write, read)


def _times(folder: Path) -> list[Path]:
    rows = [f"{1403636579763555584 + 50_000_000 * k},{k}.png\n" for k in range(5)]
    (folder / "times.csv").write_text("#timestamp [ns],filename\n" + "".join(rows))
    return [folder / "times.csv"]


def _mesh(suffix: str) -> Reader:
    def write(folder: Path) -> list[Path]:
        trimesh.creation.icosphere(1, 0.05).export(folder / f"mesh.{suffix}")
        return [folder / f"mesh.{suffix}"]

    return Reader(write, lambda folder: [load_stimulus(file) for file in folder.iterdir()])


def _memory(folder: Path) -> list[Path]:
    memory = PPSMemory.empty(icub_skin(("left_palm",)), MemoryParams())
    save_memory(folder / "memory.npz", memory)
    return [folder / "memory.npz"]


def _map(folder: Path) -> list[Path]:
    rng = np.random.default_rng(0)
    signed, optimality, error_m = rng.uniform(-1, 1, (3, 3, 4, 5))
    limits = GazeLimits()
    gaze = rng.uniform(limits.lower, limits.upper, (6, 3))
    labels = Labels(gaze, np.arange(6) < 3, rng.uniform(0, 0.1, 6), rng.uniform(0, 1, 6), gaze)
    ReachableMap("right", limits, signed, optimality, error_m, 0.1, 0.05, 0.01, labels, 0).save(folder / "map.npz")
    return [folder / "map.npz"]


def _read_map(folder: Path) -> None:
    reachable = ReachableMap.load(folder / "map.npz")
    with np.errstate(all="ignore"):
        reachable.query(np.array([[0.0, 0.0, 0.2], [0.1, -0.1, 0.3]]))


def _results(folder: Path) -> list[Path]:
    """What `batch` and `track` have written, without its pictures."""
    write_results(folder / "a")
    write_table(folder / "batch.csv", list(TRACK_TABLE), [("a", "done", 40, 40, 0.925, "", 1.5, "0.1.0", "")])
    (folder / "settings.json").write_text('["track", "--order=3"]')
    summary = {"command": "pps-vision batch a", "settings": {"order": 3}, "recordings": 1, "failed": 0}
    write_json(folder / "summary.json", {**summary, "started": "today", "seconds": 1.5, "versions": versions()})
    return sorted(file for file in folder.rglob("*") if file.suffix in (".csv", ".json"))


def _read_results(folder: Path) -> None:
    """Go on with the batch and write the reports, in a copy."""
    with TemporaryDirectory() as copy:
        out = Path(copy, "out")
        copytree(folder, out)
        run_batch([], Task("track", ("--order=3",), out, 600.0), 1)
        (out / "batch.csv").write_bytes((folder / "batch.csv").read_bytes())
        report_folder(out)


READERS: Mapping[str, Reader] = {
    "recording": Reader(_recording, _read_recording),
    "recording_of_videos": Reader(_dumped_videos, _read_recording),
    "skin_log": Reader(_skin, _read_skin),
    "taxels": Reader(_taxels, _read_taxels),
    "joint_offsets": Reader(
        _offsets, lambda folder: read_joint_offsets(folder / "joints.csv", load_icub().joint_names)
    ),
    "gaze": Reader(_gaze, lambda folder: read_gaze(folder / "gaze.csv")),
    "truth": Reader(_of_recording("truth.csv"), lambda folder: read_truth(folder / "rec/truth.csv", [])),
    "icub_eyes": Reader(
        _of_recording("icubEyes.ini"), lambda folder: read_icub_eyes(folder / "rec/icubEyes.ini", (640, 480))
    ),
    **{
        f"calibration_{form}": _calibration(form)
        for form in ("xml", "yml", "json", "npz", "mat", "kalibr", "euroc", "ros", "zed", "multical", "anipose")
    },
    "calibration_orb_slam3": _calibration("orb_slam3, fisheye"),
    "calibration_kitti": Reader(_kitti_calibration, _read_kitti_calibration),
    **{f"image_{suffix}": _image(suffix) for suffix in ("png", "jpg", "ppm", "bmp", "tiff", "webp")},
    "video_mp4": _video("mp4", "libx264"),
    "video_mkv": _video("mkv", "mpeg4"),
    "bag_bag": _bag("ros1"),
    "bag_mcap": _bag("mcap"),
    "bag_db3": _bag("sqlite3"),
    "euroc": Reader(_euroc, _read_frames),
    "kitti": Reader(_kitti, _read_frames),
    "robot": Reader(_robot, _read_robot),
    **{f"path_{form}": _path(form) for form in ("csv", "tum", "anipose")},
    **{f"boxes_{form}": _boxes(form) for form in ("ours", "mot", "otb")},
    "manifest": Reader(
        _manifest, lambda folder: jobs_of([str(folder / "list.csv")], ("left", "right", "calib", "fps"))
    ),
    "times": Reader(_times, lambda folder: read_times(folder / "times.csv")),
    **{f"mesh_{suffix}": _mesh(suffix) for suffix in ("stl", "obj", "ply")},
    "results": Reader(_results, _read_results),
    "memory": Reader(_memory, lambda folder: _use_memory(load_memory(folder / "memory.npz"))),
    "map": Reader(_map, _read_map),
}

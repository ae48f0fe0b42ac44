"""A made-up laboratory's data: videos and images of a ball, of a chessboard and of a tag, a calibration, true boxes."""

import shutil
from pathlib import Path

import cv2
import numpy as np
from calibrations import store
from data import ARM7
from flat_patterns import SIZE, K, R, T, seen
from scipy.spatial.transform import Rotation
from videos import encode

N, FPS, RADIUS_M, SHIFT = 40, 20, 0.04, 4  # OpenCV draws at 1/16 px
PATH = [np.array([-0.15 + 0.006 * k, 0.02, 0.7 - 0.002 * k]) for k in range(N)]


def place(side: int, at: np.ndarray) -> tuple[float, float]:
    """Where a point in the left camera's frame is seen."""
    u, v, w = K[side] @ (R @ at + T if side else at)
    return u / w, v / w


def photo(side: int, at: np.ndarray, wall: np.ndarray) -> np.ndarray:
    """A red ball before a wall."""
    middle = tuple(round(x * 2**SHIFT) for x in place(side, at))
    radius = round(K[side][0, 0] * RADIUS_M / at[2] * 2**SHIFT)
    return cv2.circle(wall.copy(), middle, radius, (220, 30, 30), -1, cv2.LINE_AA, SHIFT)


def film(file: Path, images: list[np.ndarray]) -> None:
    file.parent.mkdir(exist_ok=True)
    encode(file, images, FPS, crf="12", preset="veryfast")


def write(file: Path, image: np.ndarray) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(file), image[..., ::-1] if image.ndim == 3 else image)


def write_laboratory(folder: Path) -> None:
    """Write everything that the pages of the documentation name."""
    rng = np.random.default_rng(0)
    walls = [cv2.GaussianBlur(rng.integers(0, 255, (*SIZE[::-1], 3), np.uint8), (0, 0), 4) for _ in range(2)]
    photos = [[photo(side, at, walls[side]) for at in PATH] for side in range(2)]
    side_by_side = [np.hstack(pair) for pair in zip(*photos, strict=True)]
    for k, (left, right) in enumerate(zip(*photos, strict=True)):
        write(folder / f"frames/left/{k:03d}.png", left)
        write(folder / f"frames/right/{k:03d}.png", right)
    for name, images in {"left": photos[0], "right": photos[1], "both": side_by_side}.items():
        film(folder / f"{name}.mp4", images)
    for name in "ab":
        film(folder / f"recs/{name}.mp4", side_by_side[:20])
    for side, name in enumerate(("left", "right")):
        points = [f"{k},{','.join(map(str, place(side, at)))},0.97" for k, at in enumerate(PATH)]
        head = "scorer,net,net,net\nbodyparts,ball,ball,ball\ncoords,x,y,likelihood\n"
        (folder / f"{name}_points.csv").write_text(head + "\n".join(points) + "\n")
    rows = [(*(c - 29 for c in place(0, at)), 60, 60) for at in PATH]  # pixels count from 1, as in OTB
    np.savetxt(folder / "true_boxes.txt", rows, delimiter=",")
    store(folder / "calibration.yml", K1=K[0], K2=K[1], R=R, T=T)
    (folder / "tag").mkdir()
    shutil.copy(folder / "calibration.yml", folder / "tag")
    y, x = np.mgrid[:360, :540] // 60
    board = cv2.copyMakeBorder(
        np.where((x + y) % 2, 255, 0).astype(np.uint8), *[60] * 4, cv2.BORDER_CONSTANT, value=255
    )
    tag = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), 7, 240)
    tag = cv2.copyMakeBorder(tag, *[60] * 4, cv2.BORDER_CONSTANT, value=255)
    for k in range(7):
        turn = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3)).as_matrix()
        at = np.array([rng.uniform(-0.01, 0.11), rng.uniform(-0.06, 0.06), rng.uniform(0.45, 0.6)])
        for side, name in enumerate(("left", "right")):
            write(folder / f"board/{name}{k}.png", seen(board, 0.03 / 60, turn, at, side))
            write(folder / f"tag/{name}/{k}.png", seen(tag, 0.048 / 240, np.eye(3), at, side))
    shutil.copytree(ARM7.parent, folder / "arm7")

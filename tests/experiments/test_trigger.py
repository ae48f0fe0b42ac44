"""The trigger's experiment on scenes drawn by hand, where what moves, and when, is known to the pixel."""

import cv2
import numpy as np
import pytest

from pps_vision.experiments.motion_peers import PEERS, endpoint_error, regions
from pps_vision.experiments.trigger import Trigger
from pps_vision.experiments.trigger_scenes import AFTER, FPS, STARTS, Glimpse, Scene
from pps_vision.experiments.trigger_trial import MISSED, best_level, delay, flow_errors, ours, peer, read_flow, watch
from pps_vision.experiments.trigger_velocity import First, paired
from pps_vision.geometry.camera import View
from pps_vision.geometry.se3 import transform
from pps_vision.robot.icub import LEFT_EYE, load_icub
from pps_vision.robot.silhouette import Silhouette
from tracking.motion_trigger import TriggerParams

VIEW = View(LEFT_EYE, transform(translation=(10.0, 0.0, 0.0)))  # far from the robot, which it does not see
NOBODY = np.zeros((240, 320), bool)


def scene(px_per_frame: int, rng: np.random.Generator) -> Scene:
    """A textured square, 24 px wide, that starts at (150, 110) and moves to the right before a textured wall."""
    wall = cv2.blur(rng.uniform(60, 180, (240, 320, 3)), (3, 3))
    square = rng.uniform(200, 250, (24, 24, 3)) * (1.0, 0.9, 0.2)
    joints, centers, glimpses = np.zeros(load_icub().n_joints), [], []
    for k in range(STARTS + AFTER):
        x = 150 + px_per_frame * max(k - STARTS + 1, 0)
        image = wall.copy()
        image[98:122, x - 12 : x + 12] = square
        noisy = np.clip(image + rng.normal(0, 1, image.shape), 0, 255).astype(np.uint8)
        glimpses.append(Glimpse(noisy, VIEW, k / FPS, joints, NOBODY))
        centers.append([x - 0.5, 109.5])
    return Scene(tuple(glimpses), np.array(centers), 12.0)


@pytest.mark.parametrize("name", ["ours", "LK residual grid (R)", "DIS ultrafast − ego", "frame difference", "MOG2"])
def test_a_square_is_found_when_it_starts_and_not_before(name: str) -> None:
    rng = np.random.default_rng(4)
    moving, calm = scene(5, rng), scene(0, rng)
    if name == "ours":
        watcher = ours(TriggerParams(), LEFT_EYE, Silhouette(load_icub()))
    else:
        watcher = peer(name, LEFT_EYE, best_level(name, calm))
    boxes, ms = watch({name: watcher}, moving)[name]
    assert not any(boxes[2:STARTS])
    assert delay(boxes, moving) <= 3
    assert len(ms) == STARTS + AFTER


def test_what_is_elsewhere_or_never_is_missed() -> None:
    still = scene(0, np.random.default_rng(1))
    nothing: list[list[tuple[int, int, int, int]]] = [[] for _ in still.glimpses]
    assert delay(nothing, still) == MISSED
    assert delay([*nothing[:-1], [(10, 10, 20, 20)]], still) == MISSED
    assert delay([*nothing[:-1], [(150, 100, 20, 20)]], still) == AFTER


def test_every_peer_can_be_made() -> None:
    image = np.random.default_rng(0).integers(0, 255, (240, 320, 3), dtype=np.uint8)
    for name, candidate in PEERS.items():
        assert list(candidate.levels) == sorted(candidate.levels)
        look = peer(name, LEFT_EYE, candidate.levels[-1])
        seen = Glimpse(image, VIEW, 0.0, np.zeros(1), NOBODY)
        for _ in range(STARTS):
            last = look(seen)
        assert last == []  # the same image again and again


def test_regions_are_joined_and_small_ones_dropped() -> None:
    on = np.zeros((240, 320), bool)
    on[100:110, 100:110] = on[100:110, 114:120] = on[200, 200:210] = on[0:5, 0:50] = True
    assert regions(on) == [(100, 100, 20, 10)]  # 10 px are too few, and the border is not looked at


def test_flow_files_are_read_and_compared(tmp_path) -> None:
    truth = np.zeros((3, 4, 2), np.float32)
    truth[..., 0], truth[0, 0] = 2.0, 1e10
    file = tmp_path / "flow10.flo"
    file.write_bytes(b"PIEH" + np.array([4, 3], "<i4").tobytes() + truth.astype("<f4").tobytes())
    np.testing.assert_array_equal(read_flow(file), truth)
    assert endpoint_error(np.zeros((3, 4, 2), np.float32), truth) == pytest.approx(2.0)
    file.write_bytes(file.read_bytes()[:-4])
    with pytest.raises(ValueError, match=r"flow10\.flo: 104 bytes; expected 108"):
        read_flow(file)
    file.write_bytes(b"P6 4 3")
    with pytest.raises(ValueError, match="expected a Middlebury flow"):
        read_flow(file)
    assert "skipped" in str(flow_errors(tmp_path / "absent"))


def test_the_chart_shows_alarms_and_what_is_found_in_time() -> None:
    balls = {
        "ball, 5 px a frame": {"mean": 1.0, "within_3": 0.5, "missed": 0.0, "scenes": 2},
        "ball, 1 px a frame": {"mean": 1.0, "within_3": 0.0, "missed": 0.0, "scenes": 2},
    }
    time = {"q25_ms": 0.9, "median_ms": 1.0, "q75_ms": 1.1}
    good = {**time, "alarms_per_minute": 0.0, "mean_delay_frames": 1.5, "by_ball": balls}
    rows = {"variants": {"ours": good, "MOG2": {**good, "alarms_per_minute": 1200.0}}}
    figure = Trigger().chart({"heads": {"independent": rows}})
    assert {"ours", "MOG2"} <= {text.get_text() for text in figure.axes[0].texts}
    assert [bar.get_width() for bar in figure.axes[1].patches] == [50.0, 50.0]
    with pytest.raises(ValueError, match="--n 0"):
        Trigger(n=0).run()


def test_films_are_compared_in_pairs() -> None:
    slow, quick = First(3, 0.4, 4.0), First(3, 0.1, 1.0)
    result = paired([slow, slow, None, slow], [quick, quick, quick, None], seed=1)
    assert (result["films"], result["paired"]) == (4, 2)
    assert result["found"] == {"without": 3, "with": 3}
    error = result["error_m_s"]
    assert isinstance(error, dict)
    assert error["mean_difference"] == pytest.approx(-0.3)
    assert error["interval_95"] == pytest.approx([-0.3, -0.3])
    assert error["flow_better_in"] == 2

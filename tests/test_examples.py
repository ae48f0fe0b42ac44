"""The examples run, and the numbers that they print are right."""

import re
import runpy
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[1] / "docs" / "examples").glob("*.py"))


@pytest.fixture
def numbers(capsys: pytest.CaptureFixture[str]):
    """Runs an example; returns its output and the numbers in it, line by line."""

    def run(name: str) -> tuple[list[str], list[list[float]]]:
        runpy.run_path(str(next(file for file in EXAMPLES if file.name.startswith(name))), run_name="__main__")
        lines = capsys.readouterr().out.splitlines()
        return lines, [[float(n) for n in re.findall(r"(?<![\w.])-?\d+\.?\d*", line)] for line in lines]

    return run


def test_there_are_six_short_ones():
    assert [file.name[:2] for file in EXAMPLES] == ["01", "02", "03", "04", "05", "06"]
    assert all(len(file.read_text().splitlines()) <= 40 for file in EXAMPLES)


def test_a_rendered_recording_shows_the_ball_where_it_is(numbers):
    _, (pairs, offset, (_, distance_m), (red, green, blue)) = numbers("01")
    assert pairs == [20, 320, 240, 20]
    assert offset[0] < 0.01
    assert 0.2 < distance_m < 0.7
    assert red > 2 * max(green, blue)


def test_a_tracked_path_is_near_the_truth(numbers):
    _, (first, tracked, (rms_mm, expected_mm), (velocity_error, speed)) = numbers("02")
    assert first[0] < 0.5
    assert tracked[0] >= 24
    assert rms_mm < 2
    assert rms_mm / 4 < expected_mm < 4 * rms_mm
    assert velocity_error < 0.25 * speed


def test_own_images_are_tracked_with_an_own_calibration(numbers):
    _, ((tracked, _, median_mm, _), (radius_mm, *velocity)) = numbers("03")
    assert tracked >= 34
    assert median_mm < 8
    assert radius_mm == pytest.approx(40, abs=4)
    assert velocity == pytest.approx([0.18, 0.0, -0.09], abs=0.04)


def test_smoothing_helps(numbers):
    _, ((causal,), (smoothed,), (kilobytes,)) = numbers("04")
    assert smoothed < causal < 60
    assert kilobytes > 5


@pytest.mark.long
def test_the_arm_avoids_what_touches_it_otherwise(numbers):
    (off, on), ((gap_off,), (gap_on,)) = numbers("05")
    assert off.startswith("avoidance off: touched")
    assert gap_off <= 2.0
    assert on.startswith("avoidance on: not touched")
    assert gap_on > 2.0


def test_a_touch_is_learned_and_reach_is_told(numbers):
    lines, (_, activations, reachable, unreachable, error) = numbers("06")
    assert int(re.findall(r"learned (\d+) samples of touch", lines[0])[0]) >= 5
    assert activations[-3] > activations[-1] + 0.05 or activations[2] > activations[-1] + 0.05
    assert "degrees: reachable" in lines[2]
    assert "out of reach" in lines[3]
    assert reachable[-1] > 0.5 > unreachable[-1]
    assert error[0] < 5

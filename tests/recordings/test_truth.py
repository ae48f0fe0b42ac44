"""truth.csv: what is written is read back; what is not a row is named and skipped."""

from pathlib import Path

import numpy as np
import pytest

from pps_vision.errors import InputError
from pps_vision.recordings.problems import ProblemKind
from pps_vision.recordings.truth import read_truth, write_truth
from pps_vision.types import Truth

HEADER = (
    "stamp_s,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s,radius_m,"
    "u_left_px,v_left_px,u_right_px,v_right_px,visible_left,visible_right"
)
GOOD = "0.1,1,2,3,4,5,6,0.03,10,11,12,13,1,0"


def test_rows_come_back_as_they_were(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    row = Truth(
        *(1512784563.547172, rng.normal(size=3), rng.normal(size=3), np.float64(0.03)),
        *(np.array([np.nan, np.nan]), rng.normal(size=2), False, np.True_),
    )
    write_truth(tmp_path / "truth.csv", [row])
    assert (tmp_path / "truth.csv").read_text().splitlines()[0] == HEADER
    problems: list = []
    (back,) = read_truth(tmp_path / "truth.csv", problems)
    assert problems == []
    assert (back.stamp_s, back.radius_m) == (row.stamp_s, row.radius_m)
    assert (back.visible_left, back.visible_right) == (False, True)
    for name in ("position", "velocity", "left_px", "right_px"):
        np.testing.assert_array_equal(getattr(back, name), getattr(row, name))


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("0.1,1,2", "3 fields; expected 14"),
        (GOOD.replace("0.03", "abc"), "abc"),
        (GOOD.replace("0.1,1", "0.1,"), "expected finite"),
        (GOOD.replace(",1,0", ",2,0"), "visible 2,0"),
    ],
)
def test_a_bad_row_is_named_and_skipped(tmp_path: Path, row: str, message: str) -> None:
    file = tmp_path / "truth.csv"
    file.write_text("\n".join([HEADER, GOOD, row, GOOD]))
    problems: list = []
    assert len(read_truth(file, problems)) == 2
    assert [(p.kind, p.file, p.line) for p in problems] == [(ProblemKind.ROW, file, 3)]
    assert message in problems[0].message


def test_other_columns_are_refused(tmp_path: Path) -> None:
    (tmp_path / "truth.csv").write_text("t,x,y,z\n1,2,3,4\n")
    with pytest.raises(InputError, match=r"truth\.csv:1: .*expected: stamp_s"):
        read_truth(tmp_path / "truth.csv", [])
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_truth(tmp_path / "none.csv", [])

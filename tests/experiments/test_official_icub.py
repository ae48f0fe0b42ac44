"""The comparison with the official models, run again."""

import json
from pathlib import Path

import pytest

from pps_vision.experiments.official_icub import OfficialICub

RESULTS = Path(__file__).parents[2] / "docs" / "results"


def test_the_models_differ_from_ours_as_published() -> None:
    pytest.importorskip("icub_models")
    published = json.loads((RESULTS / "official_icub.json").read_text())["models"]
    found = OfficialICub().run()["models"]
    assert list(found) == list(published)
    for name, rows in found.items():
        assert [row["joint"] for row in rows] == [row["joint"] for row in published[name]]
        for key in ("offset_m", "limits_deg", "our_limits_deg"):
            for ours, theirs in zip(rows, published[name], strict=True):
                assert ours[key] == pytest.approx(theirs[key], rel=1e-4, abs=1e-6)
        assert max(row["angle_deg"] for row in rows) < 0.01

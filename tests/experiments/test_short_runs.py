"""A short run of every study gives the numbers, charts and tables that the documents show."""

from pathlib import Path

import pytest
from matplotlib.figure import Figure

from pps_vision.experiments.bench import bench
from pps_vision.experiments.study import catalogue
from pps_vision.experiments.tables import read_numbers

ROOT = Path(__file__).parents[2]
KNOWN = catalogue()


@pytest.mark.long
@pytest.mark.parametrize("name", KNOWN)
def test_a_short_run_has_every_chart_and_table(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    bench([name], out=tmp_path, short=True)
    study = KNOWN[name]()
    numbers = read_numbers(tmp_path / "results" / f"{name}.json")
    tables = study.tables(numbers)
    published = study.tables(read_numbers(ROOT / "docs" / "results" / f"{name}.json"))
    assert set(tables) == set(published)
    assert all(list(table.header) and len(table.rows) for table in tables.values())
    charts = study.chart(numbers)
    n_charts = 1 if isinstance(charts, Figure) else len(charts)
    assert len(list((tmp_path / "figures").glob("*.png"))) == n_charts

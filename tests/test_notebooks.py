"""The notebooks run: as scripts, and where the extra `notebooks` is installed in a kernel of their own."""

import json
import re
from pathlib import Path

import pytest
from laboratory import write_laboratory

NOTEBOOKS = Path(__file__).parents[1] / "docs" / "notebooks"
FOOTAGE = NOTEBOOKS / "track_your_footage.ipynb"
AVOID = NOTEBOOKS / "learn_and_avoid.ipynb"


def run(notebook: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    scope = {"__name__": "__main__"}
    for cell in json.loads(notebook.read_text())["cells"]:
        assert not cell.get("outputs")
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), str(notebook), "exec"), scope)


@pytest.mark.long
def test_own_footage_is_tracked_and_judged(tmp_path, monkeypatch, capsys):
    write_laboratory(tmp_path)
    monkeypatch.chdir(tmp_path)
    run(FOOTAGE)
    said = capsys.readouterr().out
    tracked, pairs = map(int, re.findall(r"tracked in (\d+) of (\d+) pairs", said)[0])
    assert tracked > 0.8 * pairs
    assert 76 < float(re.findall(r"(\d+) mm across", said)[0]) < 84  # its diameter is 8 cm
    assert "no cause of failure found" in said


@pytest.mark.long
def test_an_erring_robot_avoids_what_it_has_learned(capsys):
    run(AVOID)
    said = capsys.readouterr().out
    touched = [int(n) for n in re.findall(r"touched (\d) of 4", said)]
    moved = [int(n) for n in re.findall(r"moved away in (\d)", said)]
    assert touched[0] >= 3  # at rest
    assert touched[1] <= 1
    assert (moved[1], moved[3]) == (4, 0)


@pytest.mark.parametrize("notebook", [FOOTAGE, AVOID], ids=lambda file: file.stem)
def test_it_runs_in_a_kernel(notebook, tmp_path):
    pytest.importorskip("ipykernel", reason="needs the extra notebooks")
    client = pytest.importorskip("nbclient", reason="needs the extra notebooks")
    import nbformat

    write_laboratory(tmp_path)
    content = nbformat.read(notebook, as_version=4)
    nbformat.validate(content)
    client.NotebookClient(content, timeout=300, resources={"metadata": {"path": tmp_path}}).execute()

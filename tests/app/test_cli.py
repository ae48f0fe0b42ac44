"""What the commands say, and what they hand on to what does the work."""

import sys
from dataclasses import fields, is_dataclass, replace
from importlib.metadata import version
from inspect import signature
from pathlib import Path
from types import SimpleNamespace

import pytest
from matplotlib.figure import Figure

from learning.pps.memory import PPSMemory, load_memory, save_memory
from learning.reach.track_reachability import TrackReachability
from pps_vision.app.cli import COMMANDS, _class, main
from pps_vision.app.cli.batch import Batch
from pps_vision.app.cli.demo import Demo
from pps_vision.app.cli.joints import Joints
from pps_vision.app.cli.learn import Learn
from pps_vision.app.cli.reach import Train
from pps_vision.app.cli.track import Track
from pps_vision.app.cli.track2d import Track2d
from pps_vision.app.learn import Learned
from pps_vision.app.pipeline import PipelineParams
from pps_vision.app.render_params import RenderParams
from pps_vision.errors import InputError
from pps_vision.experiments.study import NOISE_SIGMA
from pps_vision.robot.skin import icub_skin

ROOT = Path(__file__).parents[2]


def test_the_arguments_are_those_of_the_process(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["pps-vision", "--version"])
    main()
    assert capsys.readouterr().out == f"pps-vision {version('pps-vision')}\n"


def test_defaults_are_those_that_the_documents_and_the_classes_state() -> None:
    text = (ROOT / "docs" / "reachable_space.md").read_text().replace("\u202f", " ").replace("\xa0", " ")
    assert f"default of {Train.ik_budget // 1000} {Train.ik_budget % 1000:03} labels" in text
    max_fp = signature(TrackReachability).parameters["max_false_positives"].default
    assert Track.max_fp == PipelineParams.max_false_positives == max_fp
    assert Demo.noise == NOISE_SIGMA
    assert {command.seed for command in (Track, Track2d, Learn, Joints, Train, Batch, Demo, RenderParams)} == {0}


def test_every_switch_is_off_unless_it_is_given() -> None:
    commands = [_class(name) for name in COMMANDS]
    switches = [field for one in commands if is_dataclass(one) for field in fields(one) if field.type is bool]
    assert len(switches) > 12
    assert [field.name for field in switches if field.default is not False] == []


def test_learning_says_what_became_of_each_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of three the first cannot be opened, the second teaches 5 samples, the third adds 7."""

    def opened(folder: Path, **options: object) -> SimpleNamespace:
        if folder.name == "a":
            raise InputError(folder, "is empty; expected a recording")
        return SimpleNamespace(name=folder.name, skipped=2, problems=[f"{folder.name} is odd"], warnings=["slow"])

    def learned(recording: SimpleNamespace, memory: PPSMemory, mode: str, seed: int, setup: object) -> Learned:
        assert (mode, seed) == ("marker", 3)
        n = 5 if recording.name == "b" else 7
        return Learned(replace(memory, counts=memory.counts + n), n, {"stale samples": n - 5, "unseen touches": 0})

    monkeypatch.setattr("pps_vision.recordings.open.open_recording", opened)
    monkeypatch.setattr("pps_vision.app.learn.learn_from", learned)
    out = tmp_path / "m.npz"
    main(["learn", "a", "b", "c", "--mode", "marker", "--seed", "3", "--out", str(out)])
    said = capsys.readouterr()
    assert said.out.splitlines() == [
        "b: 5 samples learned, 2 problems skipped",
        "c: 7 samples learned, 2 problems skipped; rejected: 2 stale samples",
        f"2 of 3 recordings learned → {out}",
    ]
    lines = [line for line in said.err.splitlines() if line.startswith(("skipped", "warning", "nothing"))]
    assert lines == [
        "skipped: a: is empty; expected a recording",
        *(line for name in "bc" for line in (f"skipped: {name} is odd", "warning: slow")),
    ]
    assert (load_memory(out).counts == 12).all()
    main(["learn", "c", "--into", str(out), "--mode", "marker", "--seed", "3", "--out", str(tmp_path / "more.npz")])
    assert (load_memory(tmp_path / "more.npz").counts == 19).all()


def test_a_batch_gives_each_of_its_recordings_the_options_for_all() -> None:
    """With --learn only those that learning knows; the others are refused."""
    bare = Batch(("a",), Path("out"))
    assert bare._options() == ["--mode=generic", "--seed=0", f"--order={Track.order}", "--unit-m=1.0"]
    common = {"mode": "marker", "seed": 4, "max_skew_s": 0.1, "calib": (Path("c.yml"),)}
    tracking = {"fps": 5.0, "unit_m": 0.01, "order": 2, "smooth": True, "also": ("tum", "mot"), "report": True}
    one = replace(bare, **common, **tracking)  # type: ignore[arg-type]
    start, calib = ["--mode=marker", "--seed=4", "--max-skew-s=0.1"], ["--calib", str(Path("c.yml").resolve())]
    words = ["--order=2", "--unit-m=0.01", "--fps=5.0", "--smooth", "--report", "--also", "tum", "mot"]
    assert one._options() == [*start, *words, *calib]
    learning = replace(bare, **common, learn=True)  # type: ignore[arg-type]
    assert learning._options() == [*start, *calib]
    for name, value in tracking.items():
        with pytest.raises(InputError, match=f"--learn with --{name.replace('_', '-')}; expected it without"):
            replace(learning, **{name: value})._options()  # type: ignore[arg-type]


def test_show_draws_the_taxels_that_were_stimulated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """All where none was."""
    drawn: list[object] = []
    monkeypatch.setattr(
        "pps_vision.app.report.figures.landscapes", lambda memory, taxels: drawn.append(taxels) or Figure()
    )
    memory, file, out = PPSMemory.empty(icub_skin(("left_palm",))), tmp_path / "m.npz", tmp_path / "m.png"
    save_memory(file, memory)
    main(["show", str(file), "--out", str(out)])
    counts = memory.counts.copy()
    counts[[1, 3], 0, 0, 1] = 9
    save_memory(file, replace(memory, counts=counts))
    main(["show", str(file), "--out", str(out)])
    assert drawn == [None, [1, 3]]
    lines = [f"{n} of {len(memory.taxel_ids)} taxels were stimulated → {out}" for n in (0, 2)]
    assert capsys.readouterr().out.splitlines() == lines


def test_render_and_demo_hand_on_their_options(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[object] = []
    monkeypatch.setattr("pps_vision.app.render.record", lambda params: asked.append(params.motion) or (80, 3))
    monkeypatch.setattr("pps_vision.app.demo.demo", lambda *words: asked.append(words))
    monkeypatch.setattr("pps_vision.app.demo_encounters.demo_encounters", lambda *words: asked.append(words))
    main(["render", "--stimulus", "ball", "--motion", "circle", "--out", str(tmp_path / "rec")])
    assert capsys.readouterr().out == f"80 pairs, skin touched in 3 → {tmp_path / 'rec'}\n"
    main(["demo", "--trials", "5", "--noise", "3", "--seed", "7", "--out", "a"])
    main(["demo", "--encounters", "4", "--noise", "3", "--seed", "7", "--out", "a"])
    assert asked == ["circle", (Path("a"), 5, 3.0, 7), (Path("a"), 4, 3.0, 7)]

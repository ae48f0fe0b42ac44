"""`import pps_vision as pv`: the public names; functions and commands give the same results."""

import dataclasses
import inspect

import numpy as np
import pytest

import pps_vision as pv
from pps_vision.app.cli import main
from pps_vision.app.cli.batch import Batch
from pps_vision.app.cli.learn import Learn
from pps_vision.app.cli.track import Track
from pps_vision.recordings.source import Options, Source
from tracking.kalman import KalmanParams
from tracking.tracker import TrackerParams

SOURCE = ("calib", "fps", "unit_m", "max_skew_s")
NAMES = {"InputError", "Pipeline", "ReachableMap", "Tracker", "__version__", "learn", "open_recording", "render"}


def test_the_names_are_there():
    assert set(dir(pv)) == NAMES | {"track", "triangulate"}
    assert all(getattr(pv, name) is not None for name in dir(pv))
    assert issubclass(pv.InputError, ValueError)
    with pytest.raises(AttributeError, match="no attribute 'tracks'"):
        _ = pv.tracks


def test_arrays_are_the_path_that_the_command_writes(approach, tmp_path):
    options = ("--order", "2", "--reduction", "2", "--seed", "3", "--smooth")
    main(["track", str(approach), "--out", str(tmp_path / "out"), *options])
    rows = [line.split(",") for line in (tmp_path / "out" / "trajectory.csv").read_text().splitlines()[1:]]
    written = np.array([[float(cell or "nan") for cell in row[:14]] for row in rows])
    path = pv.track(approach, order=2, reduction=2, seed=3).arrays(smooth=True)
    arrays = np.column_stack([path.stamps_s, path.position, path.velocity])
    np.testing.assert_allclose(arrays, written[:, :7], rtol=0, atol=1e-5, equal_nan=True)
    upper = path.cov[:, :3, :3][:, *np.triu_indices(3)]
    np.testing.assert_allclose(upper, written[:, 7:13], rtol=1e-3, atol=1e-12, equal_nan=True)
    assert path.status.tolist() == [row[14] for row in rows]


def test_what_touches_is_learned_as_by_the_command(approach, tmp_path):
    from learning.pps.memory import load_memory

    main(["learn", str(approach), "--out", str(tmp_path / "m.npz")])
    memory = pv.learn([approach])
    np.testing.assert_array_equal(memory.counts, load_memory(tmp_path / "m.npz").counts)
    assert memory.counts[..., 0].sum() > 0
    renamed = dataclasses.replace(memory, taxel_ids=tuple(f"{name}0" for name in memory.taxel_ids))
    with pytest.raises(pv.InputError, match="expected a memory of this skin"):
        pv.learn([approach], into=renamed)


def test_bad_input_has_one_exception(approach, tmp_path):
    with pytest.raises(pv.InputError, match="nowhere"):
        pv.open_recording(tmp_path / "nowhere")
    with pytest.raises(pv.InputError, match="nowhere: no such file"):
        pv.learn(str(tmp_path / "nowhere"))
    with pytest.raises(pv.InputError, match="either REC"):
        pv.open_recording()
    (tmp_path / "map.npz").write_text("none")
    with pytest.raises(pv.InputError, match=r"map\.npz"):
        pv.ReachableMap.load(tmp_path / "map.npz")


@pytest.mark.parametrize(
    ("call", "options", "said"),
    [
        ("open_recording", {"layout": "sbs"}, "recording: layout 'sbs'; expected Literal['lr', 'rl', 'tb', 'bt']"),
        ("open_recording", {"fps": 30, "max_skew_s": -1}, "max_skew_s -1; expected a finite time of at least 0 s"),
        ("track", {"seed": -1}, "track: seed -1; expected a number of at least 0"),
        ("learn", {"into": "m.npz"}, "learn: into 'm.npz'; expected PPSMemory | None"),
        ("render", {"center": (1, 2)}, "render: center (1, 2); expected tuple[float, float, float] | None"),
        ("triangulate", {"calib": "c", "unit_m": "1"}, "triangulate: unit_m '1'; expected float"),
    ],
)
def test_an_option_of_another_kind_is_named(approach, call, options, said):
    given = {"render": ("ball", "circle", "out"), "triangulate": ("l.csv", "r.csv")}.get(call, (approach,))
    with pytest.raises(pv.InputError) as error:
        getattr(pv, call)(*given, **options)
    assert said in str(error.value)
    recording = pv.open_recording(approach, stop_s=np.float32(0.1), roi=[0, 0, 40, 30])
    assert len(pv.track(recording, seed=np.int64(1), objects=np.int32(1)).arrays().stamps_s) == len(recording)


def test_an_option_that_says_nothing_about_a_recording_is_warned_of(approach):
    options = {"unit_m": 0.001, "scaled": True, "layout": "tb", "times_unit": "ms", "fps": 5}
    warnings = pv.open_recording(approach, **options).warnings
    unused = ["--fps", "--times-unit", "--layout", "--unit-m and --scaled"]
    assert [warning.split(" not used: ")[0] for warning in warnings] == unused


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"mode": "marker"}, "mode marker contradicts params with mode generic"),
        ({"order": 0}, "order 0 contradicts params with order 4"),
        ({"reduction": 2}, "reduction 2 contradicts params with reduction 1"),
        ({"objects": 4}, "objects 4 contradicts params with objects 1"),
    ],
)
def test_an_option_that_contradicts_params_is_refused(approach, options, expected):
    with pytest.raises(pv.InputError, match=f"track: {expected}; expected one of the two"):
        pv.track(approach, params=TrackerParams(), **options)


def test_options_are_the_tracker_s_parameters(approach):
    params = pv.track(approach, "marker", 2, reduction=2).params
    assert params == TrackerParams(mode="marker", reduction=2, max_objects=4, kalman=KalmanParams.of_order(2))
    assert pv.track(approach, "marker", 2, reduction=2, params=params).params is params
    assert pv.track(approach).params == TrackerParams(max_objects=4)
    assert pv.track(approach, objects=1).params == TrackerParams()
    with pytest.raises(pv.InputError, match="filter order 0; expected 1, 2, 3 or 4"):
        pv.track(approach, order=0)


def test_what_is_left_out_means_the_same_in_functions_and_commands():
    """The same in a batch."""

    def of_function(function: object) -> dict[str, object]:
        return {name: parameter.default for name, parameter in inspect.signature(function).parameters.items()}

    def of_command(command: type) -> dict[str, object]:
        return {field.name: field.default for field in dataclasses.fields(command)}

    defaults = [
        (of_function(pv.track), of_command(Track), {"device", "seed"}),
        (of_function(pv.learn), of_command(Learn), {"mode", "seed", "into"}),
        (of_command(Batch), of_command(Track), {*SOURCE, "mode", "order", "smooth", "also", "report"}),
    ]
    for ours, theirs, names in defaults:
        assert {name: ours[name] for name in names} == {name: theirs[name] for name in names}
    assert {*Options.__annotations__, "folder"} == {field.name for field in dataclasses.fields(Source)}
    assert (Track.unit_m, Track.mode, Track.smooth, Batch.workers, Batch.parquet) == (1.0, "generic", False, 1, False)

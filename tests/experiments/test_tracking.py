"""A recording of each object is tracked, and the study's table tells so."""

from drawn_study import run_and_draw

from pps_vision.experiments.tracking import Tracking


def test_ball_and_marker_are_tracked_to_a_millimetre():
    study = Tracking(n=1, seconds=1.2, seed=3, scenes="rendered", parts=("accuracy",))
    numbers, _ = run_and_draw(study)
    for cells in numbers["accuracy"]["cells"].values():
        cell = cells["tracker"]
        assert 0 < cell["mean_recording_mm"][0] == cell["worst_recording_mm"][0] < 1
        assert cell["near_percent"][0] == 100
        assert cell["ms"][1] > 0
    assert [row[0] for row in study.tables(numbers)["accuracy"].rows] == ["rendered, ball", "rendered, marker"]

"""The study of the arm's velocities: what each method keeps."""

from data import SEED

from pps_vision.experiments.arm import SOLVERS, Arm
from pps_vision.experiments.tables import markdown


def test_ours_keeps_limits_and_distance_alone_and_plain_least_squares_only_behind_the_last_stage():
    study = Arm(seed=SEED, n=3)
    numbers = study.run()
    for case, cells in numbers.items():
        ours, plain = cells["quadratic programme"], cells["damped least squares"]
        assert ours["violating_percent"][0] == ours["touching_percent"][0] == 0
        assert ours["distance_mm"][0] >= 20 - 0.01
        assert (plain["violating_percent"][0] > 0) == case.endswith("alone")
        assert 0 < ours["error_cm_s"][0] < 12
    assert len(markdown(study.tables(numbers)[""]).splitlines()) == 2 + 4 * len(SOLVERS)

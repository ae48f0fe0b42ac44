"""What the chart of triangulation says must follow from the noise: the bound holds, and who ignores it pays."""

from pps_vision.experiments.triangulation import OURS, Triangulation


def test_ours_meets_the_bound_and_the_peers_only_when_both_eyes_see_alike() -> None:
    experiment = Triangulation(n=12, seed=3)
    numbers = experiment.run()
    for name, of in numbers.items():
        assert isinstance(of, dict)
        assert 0.7 < of["alike"] < 1.3
        assert (0.7 < of["differ"] < 1.3) == (name == OURS)
    assert len(experiment.chart(numbers).axes) == 2

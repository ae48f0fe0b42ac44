"""The landscapes of R Figs 2 and 3: where the ridge lies."""

from data import SEED

from pps_vision.experiments.pps.monte_carlo import SHOWERS, MonteCarlo


def test_the_offset_shows_from_the_landing_point_and_noise_widens():
    experiment = MonteCarlo(SEED, repeats=5)
    found = {name: experiment.measured(shower, "landing") for name, shower in SHOWERS.items()}
    clean, noisy, off = (found[name] for name in ("clean", "noisy", "noisy, offset −10 cm"))
    assert 0 <= clean["crosses_ttc_0_at_cm"] < 4  # all speeds meet at 0, the fan's mean line a little beside
    assert -11.5 < off["crosses_ttc_0_at_cm"] < -8.5
    assert clean["ridge_width_cm"] < noisy["ridge_width_cm"] < off["ridge_width_cm"]
    assert clean["positive_samples_behind_the_taxel_percent"] == 0
    assert off["positive_samples_behind_the_taxel_percent"] > 30


def test_from_the_taxel_the_offset_hides():
    off = MonteCarlo(SEED, repeats=5).measured(SHOWERS["noisy, offset −10 cm"], "taxel")
    assert off["crosses_ttc_0_at_cm"] > 0


def test_the_chart_is_drawn_from_the_numbers():
    experiment = MonteCarlo(SEED, objects=60, repeats=1)
    some = {name: experiment.measured(shower, "taxel") for name, shower in SHOWERS.items()}
    figure = experiment.chart({"landscapes": {"landing": some, "taxel": some}})
    assert len([axis for axis in figure.axes if axis.images]) == 6

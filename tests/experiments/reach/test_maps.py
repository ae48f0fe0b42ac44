"""Maps and solvers of reachable space, briefly: what the full bench says of many labels, said of few."""

import numpy as np
import pytest
from data import SEED

from pps_vision.experiments.reach.maps import Maps
from pps_vision.experiments.reach.solvers import Solvers


def test_ours_needs_fewer_labels_than_what_one_would_do_at_first():
    experiment = Maps(SEED, n_test=1500, labels=(1000,))
    numbers = experiment.run()
    ours, *peers = (rows[-1] for rows in numbers["methods"].values())
    assert ours["je"] < 2
    assert all(ours["je"] < 0.6 * peer["je"] for peer in peers)
    assert ours["degree_rmse"] < 0.04
    assert numbers["query"]["in_batch_us"] < 5
    strict = [row["fp"] for row in numbers["thresholds"]]
    assert strict == sorted(strict)
    assert set(experiment.chart(numbers)) == {"", "threshold"}


def test_the_batch_is_faster_and_no_worse():
    experiment = Solvers(SEED, n=600, n_alone=12)
    numbers = experiment.run()
    for name, row in numbers["solvers"].items():
        if "ms" in row:
            assert row["with_union_percent"] >= 90, name
    batch = numbers["solvers"]["batch, NumPy, 2 starts"]
    assert batch["missed"] <= 3
    assert batch["optimality_rms"] < 0.02
    assert batch["ms"] < numbers["solvers"]["SciPy, 1 start"]["ms"]
    assert np.isfinite([row["optimality_rms"] for row in numbers["solvers"].values() if "ms" in row]).all()
    experiment.chart(numbers)


def test_what_cannot_be_measured():
    with pytest.raises(ValueError, match="100 at least"):
        Maps(labels=(50,)).run()
    with pytest.raises(ValueError, match="--n-alone 3 of --n 2"):
        Solvers(n=2, n_alone=3).run()

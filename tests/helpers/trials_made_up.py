"""Trials made up so that the answer is known, and files of them."""

import numpy as np

from pps_vision.experiments.pps.taxel_trials import Trial

TAXELS = np.array([[-0.015, 0, 0], [0.015, 0, 0], [0.0, 0.025, 0]])


def approach(rng, aimed_at, noise_m=0.002, beside_m=0.003, seconds=2.0, taxels=TAXELS):
    """An object comes down on one of the taxels at 10 cm/s and touches that one; all seen with an offset."""
    stamps = 0.1 * np.arange(round(10 * seconds))
    height = 0.1 * (stamps[-1] - stamps) + 0.001
    landing = taxels[aimed_at] + np.array([0.01, -0.02, 0.0]) + rng.normal(0, beside_m, 3)
    p = landing + height[:, None] * np.array([0, 0, 1.0]) + rng.normal(0, noise_m, (len(stamps), 3))
    v = np.tile([0.0, 0.0, -0.1], (len(stamps), len(taxels), 1))
    return Trial(stamps, p[:, None] - taxels, v, np.arange(len(taxels)) == aimed_at)


def session(rng, n, **how):
    """Trials that aim at the first two taxels in turn, never at the third."""
    return tuple(approach(rng, i % 2, **how) for i in range(n))


def write(path, trials, **changes):
    """A file in the authors' layout; `changes` replace arrays, or leave out those that are None."""
    taxels = range(len(trials[0].touched))
    data = {
        "position_m": np.concatenate([t.d_m[:, k] for t in trials for k in taxels]),
        "velocity_m_s": np.concatenate([t.v_m_s[:, k] for t in trials for k in taxels]),
        "offsets": np.cumsum([0] + [len(t.stamps_s) for t in trials for k in taxels]),
        "outcome": np.array([np.where(t.touched, 1, -1) for t in trials]),
    }
    np.savez(path, **{k: v for k, v in {**data, **changes}.items() if v is not None})
    return path

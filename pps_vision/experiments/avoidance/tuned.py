"""Parameters of the baseline controllers: R's, or chosen by hand within the ranges of the registry.

To be replaced by the best of docs/results/encounters_tuning.json, once `bench encounters_tuning` has run.
"""

TUNED: dict[str, dict[str, float]] = {
    "R eq. 6": {"threshold": 0.4, "confirm_s": 0.0, "persist_s": 0.3},
    "distance only": {"threshold": 0.4, "confirm_s": 0.0, "persist_s": 0.3},
    "potential field": {"range_m": 0.15, "gain": 0.001, "home_per_s": 1.0},
    "depth space": {"range_m": 0.2, "aside": 0.5},
    "taxel constraints": {"threshold": 0.4, "gain": 3.0, "home_per_s": 1.0},
}

"""Parameters of the baseline controllers: the best of docs/results/encounters_tuning.json."""

TUNED: dict[str, dict[str, float]] = {
    "R eq. 6": {"threshold": 0.6724, "confirm_s": 0.1709, "persist_s": 0.4385},
    "distance only": {"threshold": 0.5697, "confirm_s": 0.1637, "persist_s": 0.2927},
    "potential field": {"range_m": 0.05052, "gain": 0.01153, "home_per_s": 2.779},
    "depth space": {"range_m": 0.06458, "aside": 0.8589},
    "taxel constraints": {"threshold": 0.3982, "gain": 0.5341, "home_per_s": 1.146},
}

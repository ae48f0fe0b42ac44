"""Parameters of the baseline controllers: the best of the part `tuning` of `bench encounters`."""

TUNED: dict[str, dict[str, float]] = {
    "R eq. 6": {"threshold": 0.4203, "confirmation_s": 0.1306, "persist_s": 0.3889},
    "distance only": {"threshold": 0.4319, "confirmation_s": 0.1949, "persist_s": 0.5954},
    "potential field": {"range_m": 0.06314, "gain": 0.009452, "home_per_s": 1.112},
    "depth space": {"range_m": 0.08746, "aside": 0.2517},
    "taxel constraints": {"threshold": 0.5284, "gain": 13.8, "home_per_s": 0.6069},
}

"""Surfaces that geometry does not know."""

import numpy as np

from pps_vision.experiments.encounters.unknown import Subject, activation_ahead, bare, learned, trial_of, world


def test_the_receptive_field_grows_to_a_stick_with_touches_and_shrinks_without_it():
    rng = np.random.default_rng(5)
    naive = Subject.naive("left")
    trials = [trial_of("stick", "left", "through", rng) for _ in range(8)]
    probes = [trial_of("stick", "left", "through", rng)]
    assert activation_ahead(naive, probes) == 0
    holding = learned(naive, world("left", "stick"), trials)
    held = activation_ahead(holding, probes)
    assert held > 0.4
    without = learned(holding, bare(), 4 * trials)
    assert activation_ahead(without, probes) < min(0.4, 0.5 * held)
    assert not len(learned(naive, bare(), trials).memory.places)

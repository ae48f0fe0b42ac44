"""Surfaces that geometry does not know."""

import numpy as np

from pps_vision.experiments.encounters.unknown import Subject, activation_ahead, bare, learned, trial_of, world


def test_the_receptive_field_grows_to_a_stick_with_touches_and_shrinks_without_it():
    rng = np.random.default_rng(5)
    subject = Subject.naive("left")
    trials = [trial_of("stick", "left", "through", rng) for _ in range(8)]
    probes = [trial_of("stick", "left", "through", rng)]
    assert activation_ahead(subject, probes) == 0
    for trial in trials:
        subject = learned(subject, world("left", "stick"), trial)
    held = activation_ahead(subject, probes)
    assert held > 0.4
    for trial in 4 * trials:
        subject = learned(subject, bare(), trial)
    assert activation_ahead(subject, probes) < min(0.4, 0.5 * held)

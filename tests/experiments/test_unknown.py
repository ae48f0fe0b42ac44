"""Surfaces that geometry does not know."""

import numpy as np

from learning.pps.memory import PPSMemory
from pps_vision.experiments.encounters.unknown import PARAMS, activation_ahead, bare, learned, trial_of, world


def test_the_receptive_field_grows_to_a_stick_with_touches_and_shrinks_without_it():
    rng = np.random.default_rng(5)
    memory = PPSMemory.empty(bare().skins["left"], PARAMS)
    trials = [trial_of("stick", "left", "through", rng) for _ in range(8)]
    probes = [trial_of("stick", "left", "through", rng)]
    assert activation_ahead(memory, "left", probes) == 0
    for trial in trials:
        memory = learned(memory, world("left", "stick"), trial)
    held = activation_ahead(memory, "left", probes)
    assert held > 0.4
    for trial in 4 * trials:
        memory = learned(memory, bare(), trial)
    assert activation_ahead(memory, "left", probes) < min(0.4, 0.5 * held)

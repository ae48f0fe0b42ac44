"""Learn which approaches touch, and ask which fixated points the hand can reach."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import pps_vision as pv
from learning.pps.memory import activation
from learning.reach.params import MapParams
from learning.reach.training import train_reachable_map

with TemporaryDirectory() as folder:
    place = Path(folder)
    recording = pv.render(
        "ball", "approach", place / "rec", target="left_forearm:3", speed=0.15, seconds=1.7, noise=2.0, seed=6
    )
    memory = pv.learn([recording])
    taxel = memory.taxel_ids.index("left_forearm:3")
    touch, no_touch = memory.samples[taxel]
    near = activation(memory, 0.05, 0.4)[taxel]  # one distance and time to contact for all taxels
    distant = activation(memory, 0.18, 2.5)[taxel]
    print(f"left_forearm:3 learned {touch:.0f} samples of touch, {no_touch:.0f} of no touch")
    print(f"activation at 5 cm and 0.4 s to contact {near:.2f}, at 18 cm and 2.5 s {distant:.2f}")

    params = replace(MapParams(), n_labels=600, round_labels=300, n_babble=20_000, lattice=0.15, n_test=500)
    train_reachable_map(recording.robot, "left", np.random.default_rng(7), params).save(place / "reach.npz")
    reach = pv.ReachableMap.load(place / "reach.npz")
    gaze_deg = np.array([[20.0, -20.0, 15.0], [20.0, -20.0, 5.5]])  # yaw, pitch, vergence
    verdict = reach.query(np.deg2rad(gaze_deg))
    for gaze, reachable, degree in zip(gaze_deg, verdict.reachable, verdict.degree, strict=True):
        print(f"gaze {gaze} degrees: {'reachable' if reachable else 'out of reach'}, degree {degree:.2f}")
    print(f"at most {100 * reach.error_bound:.1f} % of all gaze postures are misjudged, with 95 % confidence")

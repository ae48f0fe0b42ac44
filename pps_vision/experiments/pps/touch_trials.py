"""The trials of R's three milestones: what the robot knew of what touched it, as learning starts from it."""

from pathlib import Path

import numpy as np

from learning.pps.touch_trial import TouchTrial
from pps_vision.experiments.pps.touch_films import watched
from pps_vision.experiments.pps.touch_movements import Condition, Movement, movements


def touch_trials(
    condition: Condition, n: int, seed: int, seen: bool = False, folder: Path | None = None, touching: bool = True
) -> tuple[TouchTrial, ...]:
    """The first `n` trials of a seed (see `movements`); `touched` is of the whole `icub_skin()`.

    What is known of the object is the truth, or with `seen` what the tracker makes of rendered frames, which
    `folder` keeps.  ValueError for a condition, a number or a place that cannot be.
    """
    made = movements(condition, n, seed, touching)
    if not seen:
        return tuple(known(movement) for movement in made)
    if condition == "motor" or folder is None:
        raise ValueError(
            f"rendered trials of {condition} in {folder}; expected a folder, and not motor, which is blind"
        )
    return watched(made, folder)


def known(movement: Movement) -> TouchTrial:
    """A trial of a robot that knows all: the truth, with no doubt about it."""
    T = len(movement.stamps_s)
    return TouchTrial(
        movement.stamps_s,
        movement.joints_rad,
        movement.positions,
        movement.velocities,
        np.zeros((T, 3, 3)),
        np.full(T, movement.radius_m),
        movement.touched,
        movement.aimed,
    )

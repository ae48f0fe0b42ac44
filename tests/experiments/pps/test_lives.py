"""A robot whose encoders are off sees things off, and less so once it has learned by how much."""

import numpy as np
from data import SEED

from pps_vision.experiments.pps.errors import Belief, ErrorSources, only
from pps_vision.experiments.pps.held_out import known_trials
from pps_vision.experiments.pps.lives import Life, calibrated, error_mm, live
from pps_vision.robot.skin import icub_skin


def test_touches_tell_a_robot_what_its_encoders_leave_out() -> None:
    trials = known_trials("inner", 8, SEED)

    def life(belief: Belief) -> Life:
        return live(belief, trials, np.random.default_rng(SEED))

    def draw(sources: ErrorSources) -> Life:
        return life(Belief.draw(sources, icub_skin(), np.random.default_rng((SEED, 1))))

    none = ErrorSources(**dict.fromkeys(vars(ErrorSources()), 0.0))
    true, off = draw(only()), draw(ErrorSources(**{**vars(none), "joint_rad": np.deg2rad(4.0)}))
    assert error_mm(true, true) == 0
    assert error_mm(true, off) > 20
    assert error_mm(true, life(calibrated(off))) < 0.5 * error_mm(true, off)

"""The map that `reach train` learns by default, of each arm and of both at once, judged in closed form."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from tqdm import tqdm

from learning.reach.map import both
from learning.reach.training import train_reachable_map
from pps_vision.experiments.reach_truth import ARMS, SCORES, MapTruth, map_params
from pps_vision.experiments.tables import Table
from pps_vision.robot.icub import load_icub


def run(seeds: Sequence[int], n_labels: int, n_test: int) -> dict[str, Any]:
    """Return the scores (percent, RMS of R) and the reachable share (percent) of every map."""
    robot = load_icub()
    params = map_params(n_labels)
    rows = []
    for seed in tqdm(seeds, desc="seeds", unit="pair of maps", disable=None):
        left, right = (MapTruth.of(robot, n_test, np.random.default_rng(seed + 1_000_000), arm) for arm in ARMS)
        maps = [train_reachable_map(robot, arm, np.random.default_rng(seed), params) for arm in ARMS]
        for truth, learned in zip((left, right, left.with_arm(right)), (*maps, both(*maps)), strict=True):
            scores = truth.judge(learned.query, learned.max_error_m)
            rows.append({"seed": seed, "arm": learned.side, "reachable": 100 * float(truth.reachable.mean()), **scores})
    return {"maps": rows}


def table(numbers: dict[str, Any]) -> Table:
    """Return mean and largest score of the maps of each arm, and of both."""
    rows = []
    for arm in (*ARMS, "both"):
        maps = [row for row in numbers["maps"] if row["arm"] == arm]
        reachable = f"{np.mean([row['reachable'] for row in maps]):.3g}"
        scores = ([row[key] for row in maps] for key in SCORES.values())
        rows.append([arm, str(len(maps)), reachable, *(f"{np.mean(score):.2g} / {max(score):.2g}" for score in scores)])
    return Table(["arm", "maps", "reachable (%)", *(f"{name}: mean / largest" for name in SCORES)], rows)

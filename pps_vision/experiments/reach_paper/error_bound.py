"""Whether the stated bound of a map's error holds: maps of both arms, learned until the bound or the budget is met."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from tqdm import tqdm

from learning.reach.training import train_reachable_map
from pps_vision.experiments.reach_truth import ARMS, closed_form, map_params
from pps_vision.experiments.study import percent_of
from pps_vision.experiments.tables import Table, estimate
from pps_vision.robot.gaze import fixation_points
from pps_vision.robot.icub import load_icub


def run(seed: int, n: int, bounds: Sequence[float], n_labels: int, n_test: int) -> dict[str, Any]:
    """Return for each map the requested, stated and measured error, and the share of bounds that hold."""
    robot = load_icub()
    maps: list[dict[str, Any]] = []
    for i, requested in enumerate(bounds):
        params = replace(map_params(n_labels), max_error=requested)
        for k in tqdm(range(n), f"{requested:g}", unit="pair of maps", disable=None):
            for arm_index, arm in enumerate(ARMS):
                rng = np.random.default_rng((seed + k, arm_index, i))
                learned = train_reachable_map(robot, arm, rng, params)
                gaze = rng.uniform(learned.limits.lower, learned.limits.upper, (n_test, 3))
                reachable = np.isfinite(closed_form(robot, arm).solve(fixation_points(robot, gaze))[:, 0])
                maps.append(
                    {
                        "requested": requested,
                        "arm": arm,
                        "labels": len(learned.labels.gaze_rad) + learned.unanswered,
                        "stated": learned.error_bound,
                        "measured": float(np.mean(learned.query(gaze).reachable != reachable)),
                    }
                )
    return {"maps": maps, "hold_percent": percent_of(_n_holding(maps), len(maps))}


def table(numbers: dict[str, Any]) -> Table:
    """Return for each requested bound and arm: maps, bounds that hold, requests met, and means."""
    rows = []
    for requested in dict.fromkeys(row["requested"] for row in numbers["maps"]):
        for arm in ARMS:
            maps = [row for row in numbers["maps"] if row["requested"] == requested and row["arm"] == arm]
            met = sum(row["stated"] <= requested for row in maps)
            shares = (f"{100 * np.mean([row[key] for row in maps]):.3g}" for key in ("stated", "measured"))
            labels = f"{np.mean([row['labels'] for row in maps]):.0f}"
            counts = (str(count) for count in (len(maps), _n_holding(maps), met))
            rows.append([f"{100 * requested:g} %, {arm}", *counts, *shares, labels])
    holding = f"{_n_holding(numbers['maps'])}; {estimate(numbers['hold_percent'])} %"
    rows.append(["all", str(len(numbers["maps"])), holding, *["–"] * 4])
    header = ["requested", "maps", "bounds that hold", "requests met", "stated (%)", "measured (%)", "labels"]
    return Table(header, rows)


def _n_holding(maps: list[dict[str, Any]]) -> int:
    return sum(row["measured"] <= row["stated"] for row in maps)

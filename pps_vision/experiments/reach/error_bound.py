"""Does the stated bound of a map's error hold?  Maps of both arms, learned until the bound or the budget is met."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from learning.reach.params import MapParams
from learning.reach.training import train_reachable_map
from pps_vision.experiments import charts
from pps_vision.experiments.reach.map_truth import closed_form
from pps_vision.experiments.study import SampledStudy, percent_of
from pps_vision.experiments.tables import Table, estimate
from pps_vision.robot.gaze import fixation_points
from pps_vision.robot.icub import load_icub

ARMS = ("left", "right")


@dataclass(frozen=True)
class ErrorBound(SampledStudy):
    """Stated upper bound of the share misjudged beside the share measured by closed-form inverse kinematics."""

    SHORT: ClassVar[Mapping[str, Any]] = {"requested": (0.05,)}

    n: int = 10
    """Maps of each arm for each requested bound."""
    requested: tuple[float, ...] = (0.01, 0.003, 0.001)
    """Requested bounds."""
    n_labels: int = 24_000
    """Labels to learn from, at most."""
    n_test: int = 100_000
    """Gaze postures at which a map is judged."""

    def run(self) -> dict[str, Any]:
        """Return for each map what was requested, stated and measured, and how many bounds hold."""
        robot = load_icub()
        maps: list[dict[str, Any]] = []
        rounds = min(MapParams().round_labels, self.n_labels // 2)
        for i, requested in enumerate(self.requested):
            params = replace(MapParams(), n_labels=self.n_labels, round_labels=rounds, max_error=requested)
            for k in tqdm(range(self.n), f"{requested:g}", unit="pair of maps", disable=None):
                for side in ARMS:
                    rng = np.random.default_rng((self.seed + k, ARMS.index(side), i))
                    learned = train_reachable_map(robot, side, rng, params)
                    limits = learned.limits
                    gaze = rng.uniform(limits.lower, limits.upper, (self.n_test, 3))
                    true = np.isfinite(closed_form(robot, side).solve(fixation_points(robot, gaze))[:, 0])
                    measured = float(np.mean(learned.query(gaze).reachable != true))
                    maps.append(
                        {
                            "requested": requested,
                            "arm": side,
                            "labels": len(learned.labels.gaze_rad) + learned.unanswered,
                            "stated": learned.error_bound,
                            "measured": measured,
                        }
                    )
        held = sum(one["measured"] <= one["stated"] for one in maps)
        return {"maps": maps, "hold_percent": percent_of(held, len(maps))}

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Draw the measured share over the stated bound."""
        figure, (axis,) = charts.panels(1, width=5.2)
        for arm in ARMS:
            of = [one for one in numbers["maps"] if one["arm"] == arm]
            axis.plot([100 * m["stated"] for m in of], [100 * m["measured"] for m in of], "o", ms=4, label=f"{arm} arm")
        ends = 100 * np.array(
            [min(one["measured"] for one in numbers["maps"]), 1.2 * max(one["stated"] for one in numbers["maps"])]
        )
        axis.plot(ends, ends, color="k", lw=0.8, ls="--")
        axis.set(xlabel="stated: at most (%)", ylabel="measured misjudged (%)", xscale="log", yscale="log")
        axis.grid(alpha=0.25, which="both")
        axis.legend(fontsize=8)
        return figure

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return for each requested bound and arm: maps, bounds that hold, requests met, and mean shares."""
        rows = []
        for requested in dict.fromkeys(one["requested"] for one in numbers["maps"]):
            for arm in ARMS:
                of = [m for m in numbers["maps"] if m["requested"] == requested and m["arm"] == arm]
                hold, met = (sum(c) for c in ([m["measured"] <= m["stated"] for m in of], _met(of, requested)))
                shares = (f"{100 * np.mean([m[key] for m in of]):.3g}" for key in ("stated", "measured"))
                labels = f"{np.mean([m['labels'] for m in of]):.0f}"
                rows.append([f"{100 * requested:g} %, {arm}", str(len(of)), str(hold), str(met), *shares, labels])
        n_hold = sum(m["measured"] <= m["stated"] for m in numbers["maps"])
        of_all = f"{n_hold}; {estimate(numbers['hold_percent'])} %"
        rows.append(["all", str(len(numbers["maps"])), of_all, *["–"] * 4])
        header = ["requested", "maps", "bounds that hold", "requests met", "stated (%)", "measured (%)", "labels"]
        return {"": Table(header, rows)}


def _met(maps: list[dict[str, Any]], requested: float) -> list[bool]:
    return [one["stated"] <= requested for one in maps]

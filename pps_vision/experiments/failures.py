"""Where tracking breaks: one disturbance at a time, from mild to hopeless, ours beside the peers."""

from dataclasses import asdict, dataclass
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tqdm import tqdm

from pps_vision.experiments.failure_cases import CASES, Case, Group
from pps_vision.experiments.failure_methods import OURS, PEERS, Peers, judge, track_ours
from pps_vision.experiments.failure_scenes import Scenes as FailureScenes
from pps_vision.experiments.failure_scenes import stage_props
from pps_vision.experiments.footage import Footage, open_studio
from pps_vision.experiments.scene_sources import by_source
from pps_vision.experiments.study import Scenes, SceneSource, Study

BREAKS_BELOW, DEGRADES_ABOVE = 0.9, 3.0
CRITERION = (
    f"breaks: near the object in less than {BREAKS_BELOW:.0%} of the frames that count; degrades: 3D RMS error more "
    f"than {DEGRADES_ABOVE:.0f} times that of the mildest severity"
)
_TITLES: dict[Group, str] = {"light": "Light", "scene": "Scene", "time": "Time", "eyes": "Eyes and calibration"}
_STYLES = {
    "ours": ("tab:blue", "-", 2.2),
    "ours, marker": ("tab:cyan", "--", 1.4),
    "two CSRT": ("tab:orange", "-", 1.2),
    "two KCF": ("tab:red", "--", 1.2),
    "two CamShift": ("tab:brown", ":", 1.4),
}
_COLUMNS = 5
METHODS = (*OURS, *PEERS)


@dataclass(frozen=True)
class Failures(Study):
    """A red ball before a robot that looks at it, and everything that can go wrong, each alone and from mild to
    hopeless.  Ours has to find the ball; the peers are given its true boxes in the first frame."""

    n: int = 1
    """Recordings of every severity."""
    seed: int = 0
    """Seed of the first; the others count up."""
    csrt: bool = True
    """Whether CSRT is put on them too, on the first recordings only: it takes more time than all the rest."""
    scenes: Scenes = "both"
    """Rendered scenes, independent ones (which do not show the robot's arms), or both."""

    def run(self) -> dict[str, object]:
        """By disturbance, by method: success, error and wrongness at each severity, and where it breaks."""
        if self.n < 1:
            raise ValueError(f"bench failures: --n {self.n}; expected at least 1")
        return by_source(self.scenes, self._measure)

    def _measure(self, source: SceneSource) -> dict[str, Any]:
        cases = [case for case in CASES if source == "rendered" or case.name != "own arm moves"]
        scores: dict[str, list[Any]] = {case.name: [] for case in cases}
        with open_studio(stage_props(), source, self.seed) as studio:
            for k in range(self.n):
                scenes, peers = FailureScenes(studio, self.seed + k), Peers()
                for case in tqdm(cases, desc=f"recording {k + 1} of {self.n}", unit="disturbance", disable=None):
                    shown = (case.show(scenes, severity) for severity in case.severities)
                    scores[case.name].append(
                        [_scores(footage, peers, self.seed + k, self.csrt and k == 0) for footage in shown]
                    )
        return {"criterion": CRITERION, "cases": {case.name: summary(case, scores[case.name]) for case in cases}}

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """One figure a group of disturbances: above success, below error."""
        return {group: _figure(group, numbers["cases"]) for group in _TITLES}


def _scores(footage: Footage, peers: Peers, seed: int, with_csrt: bool) -> dict[str, dict[str, float]]:
    """Of every method."""
    tracks = {name: track_ours(params, footage, seed) for name, params in OURS.items()}
    tracks |= {name: peers.track(peer, footage) for name, peer in PEERS.items() if peer != "CSRT" or with_csrt}
    return {name: asdict(judge(footage, track)) for name, track in tracks.items()}


def summary(case: Case, recordings: list[list[dict[str, dict[str, float]]]]) -> dict[str, Any]:
    """Means over the recordings (of the squares, for the error)."""
    methods: dict[str, object] = {}
    for name in METHODS:
        with_it = [recording for recording in recordings if name in recording[0]]
        if not with_it:
            continue
        success, rms, wrong = (
            np.array([[severity[name][key] for severity in recording] for recording in with_it])
            for key in ("success", "rms_m", "wrong")
        )
        shares, rms_mm = success.mean(axis=0), 1000 * _root_mean_square(rms)
        methods[name] = {
            "success": [round(float(value), 4) for value in shares],
            "rms_mm": [round(float(value), 3) if np.isfinite(value) else None for value in rms_mm],
            "wrong": [round(float(value), 4) for value in wrong.mean(axis=0)],
            "breaks_at": _first(case.severities, shares < BREAKS_BELOW),
            "degrades_at": _first(case.severities, rms_mm > DEGRADES_ABOVE * rms_mm[0]),
        }
    return {"group": case.group, "axis": case.axis, "severities": list(case.severities), "methods": methods}


def _root_mean_square(rms: Any) -> Any:
    """Over the recordings (rows) in which the object was known at all; NaN where in none."""
    known = np.isfinite(rms)
    total, count = np.where(known, rms, 0.0) ** 2, known.sum(axis=0)
    return np.where(count > 0, np.sqrt(total.sum(axis=0) / np.maximum(count, 1)), np.nan)


def _first(severities: tuple[float, ...], is_bad: Any) -> float | None:
    """The mildest severity that is bad; None where none is."""
    return float(severities[int(np.argmax(is_bad))]) if np.any(is_bad) else None


def _figure(group: Group, cases: dict[str, Any]) -> Figure:
    names = [name for name, case in cases.items() if case["group"] == group]
    blocks = -(-len(names) // _COLUMNS)
    columns = -(-len(names) // blocks)
    figure, axes = plt.subplots(
        2 * blocks, columns, figsize=(3.1 * columns, 4.2 * blocks + 0.8), squeeze=False, layout="constrained"
    )
    for axis in axes.flat:
        axis.set_visible(False)
    for k, name in enumerate(names):
        above, below = axes[2 * (k // columns)][k % columns], axes[2 * (k // columns) + 1][k % columns]
        _panel(above, below, name, cases[name], k % columns == 0)
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels) + 1, fontsize=9, frameon=False)
    figure.suptitle(f"{_TITLES[group]}: where tracking breaks (×: near the object in less than 90 % of the frames)")
    return figure


def _panel(above: Axes, below: Axes, name: str, case: dict[str, Any], is_first: bool) -> None:
    """Success over severity, and under it the 3D error."""
    places = np.arange(len(case["severities"]))
    for axis in (above, below):
        axis.set_visible(True)
        axis.set_xticks(places, [f"{value:g}" for value in case["severities"]])
        axis.grid(alpha=0.25)
        axis.tick_params(labelsize=8)
    for method, numbers in case["methods"].items():
        color, line, width = _STYLES[method]
        share = 100 * np.array(numbers["success"])
        above.plot(places, share, line, color=color, lw=width, label=method)
        if numbers["breaks_at"] is not None:
            k = case["severities"].index(numbers["breaks_at"])
            above.plot(k, share[k], "x", color=color, ms=8, mew=2)
        below.plot(places, np.array(numbers["rms_mm"], dtype=float), line, color=color, lw=width, marker=".", ms=4)
    above.axhline(100 * BREAKS_BELOW, color="0.4", lw=0.8, ls="--")
    above.set_ylim(-4, 104)
    above.set_title(name, fontsize=10)
    below.set_yscale("log")
    below.set_xlabel(case["axis"], fontsize=9)
    if is_first:
        above.set_ylabel("near the object (%)", fontsize=9)
        below.set_ylabel("3D RMS (mm)", fontsize=9)

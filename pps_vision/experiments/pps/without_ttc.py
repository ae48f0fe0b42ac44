"""The earlier model that knows only distance beside the one that knows time to contact too (R, "Comparison
with model without TTC information", S2 Fig): what each makes of what comes, goes, and stands still."""

from dataclasses import dataclass, replace
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from control.avoidance import AvoidanceParams
from learning.pps.memory import MemoryParams, PPSMemory, activation
from learning.pps.scores import auroc, brier, expected_calibration_error
from learning.pps.touch_trial import TouchTrial
from pps_vision.experiments.pps.held_out import Approach, approaches, at_horizon, known_trials, learned, of_part
from pps_vision.experiments.study import Study
from pps_vision.robot.icub import HOME_ARM_RAD, load_icub
from pps_vision.robot.skin import Skin, icub_skin
from pps_vision.types import Array, Mask

MODELS = {
    "distance and TTC": MemoryParams(),
    "distance only": MemoryParams(ttc_range_s=(-np.inf, np.inf), bins=(8, 1)),
}
TRIALS = 53
STEPS = (1, 2, 4, 8, 16, 32, 53, 80, 106)
CLOSE_TO_FINAL = 0.05  # mean difference of activations at which a map counts as converged
PART = "left_forearm"
_STANDS_S = 2.0
_THRESHOLD, _CONFIRM_S = AvoidanceParams(HOME_ARM_RAD).threshold, AvoidanceParams(HOME_ARM_RAD).confirm_s


@dataclass(frozen=True)
class WithoutTtc(Study):
    """Both learn from the same trials; then the same objects approach, withdraw, stop before the skin, or pass."""

    seed: int = 0
    """Seed of the trials; those held out have the next."""

    def run(self) -> dict[str, Any]:
        """By model: alarms by what the object does, lead time, calibration, and how soon the map is there."""
        whole = icub_skin()
        skin, robot = of_part(whole, PART), load_icub()
        lessons = approaches(known_trials("inner", TRIALS, self.seed), robot, skin, whole)
        held_out = known_trials("inner", TRIALS, self.seed + 1)
        shown = {
            "approaching": held_out,
            "withdrawing": tuple(map(_reversed, held_out)),
            "standing still": tuple(map(_stopped, held_out)),
        }
        scenes = {what: approaches(trials, robot, skin, whole) for what, trials in shown.items()}
        return {
            "seed": self.seed,
            **{name: _measured(params, skin, lessons, scenes) for name, params in MODELS.items()},
        }

    def chart(self, numbers: dict[str, Any]) -> Figure:
        """Alarms, lead time, reliability over trials."""
        figure, axes = plt.subplots(1, 3, figsize=(13, 4.2), layout="constrained")
        _alarms(axes[0], numbers)
        _lead(axes[1], numbers)
        _convergence(axes[2], numbers)
        return figure


def _reversed(trial: TouchTrial) -> TouchTrial:
    """The same path backwards, from the skin."""
    return replace(trial, positions=trial.positions[::-1], velocities=-trial.velocities[::-1])


def _stopped(trial: TouchTrial) -> TouchTrial:
    """The object stands where it was half-way through the trial."""
    T = int(_STANDS_S / 0.05)
    at = np.full(T, len(trial.stamps_s) // 2)
    kept = {name: getattr(trial, name)[at] for name in ("joints_rad", "positions", "velocity_covs", "radius_m")}
    return replace(trial, stamps_s=0.05 * np.arange(T), velocities=np.zeros((T, 3)), **kept)


def _measured(
    params: MemoryParams, skin: Skin, lessons: tuple[Approach, ...], scenes: dict[str, tuple[Approach, ...]]
) -> dict[str, Any]:
    memory = learned(skin, params, lessons)
    coming = scenes["approaching"]
    D, TTC, touched = at_horizon(coming)
    expected = activation(memory, D, TTC)
    leads = np.concatenate([_lead_s(memory, trial)[trial.touched] for trial in coming])
    every = lessons + coming
    distances = _distances_to_final(params, skin, every)
    close = [n for n, away in zip(STEPS, distances, strict=True) if away <= CLOSE_TO_FINAL]
    return {
        "alarms_percent": {
            what: 100 * float(np.mean([_alarm(memory, trial).any() for trial in trials]))
            for what, trials in scenes.items()
        },
        "samples_above_threshold_percent": {
            what: 100 * float(np.mean(np.concatenate([_above(memory, trial).any(axis=1) for trial in trials])))
            for what, trials in scenes.items()
        },
        "lead_s": [round(float(lead), 3) for lead in leads],
        "lead_median_s": float(np.median(leads)),
        "touches_expected_percent": 100 * float(np.mean(leads > 0)),
        "auroc": auroc(touched, expected),
        "brier": brier(touched, expected),
        "expected_calibration_error": expected_calibration_error(touched, expected),
        "trials": list(STEPS),
        "distance_to_final_map": distances,
        "trials_to_converge": close[0],
        "samples_to_converge": int(learned(skin, params, every[: close[0]]).counts.sum()),
    }


def _above(memory: PPSMemory, trial: Approach) -> Mask:
    above: Mask = activation(memory, trial.distance_m, trial.ttc_s) > _THRESHOLD
    return above


def _alarm(memory: PPSMemory, trial: Approach) -> Mask:
    """(T,) when the arm would move: some taxel above threshold, without a break, for as long as it asks."""
    above = np.asarray(_above(memory, trial).any(axis=1))
    n = int(np.ceil(_CONFIRM_S / 0.05 - 1e-6)) + 1
    held = np.convolve(above, np.ones(n), "full")[: len(above)]
    alarm: Mask = held > n - 0.5
    return alarm


def _lead_s(memory: PPSMemory, trial: Approach) -> Array:
    """(n,) how long before the touch a taxel is above threshold from then on; 0 if it is not."""
    above = _above(memory, trial)[::-1]
    steady = np.where(above.all(axis=0), len(above), np.argmin(above, axis=0))
    lead: Array = np.where(steady > 0, trial.left_s[::-1][np.maximum(steady - 1, 0)], 0.0)
    return lead


def _distances_to_final(params: MemoryParams, skin: Skin, lessons: tuple[Approach, ...]) -> list[float]:
    """Mean difference between the activations of a map of some trials and that of all, on what all perceived."""
    D, TTC = (np.concatenate([getattr(trial, name) for trial in lessons]) for name in ("distance_m", "ttc_s"))
    final = activation(learned(skin, params, lessons), D, TTC)
    here = params.covers(D, TTC)
    return [float(np.abs(activation(learned(skin, params, lessons[:n]), D, TTC) - final)[here].mean()) for n in STEPS]


_COLORS = dict(zip(MODELS, ("tab:blue", "tab:orange"), strict=True))


def _alarms(axis: Axes, numbers: dict[str, Any]) -> None:
    for k, name in enumerate(MODELS):
        shares = numbers[name]["alarms_percent"]
        for x, share in enumerate(shares.values()):
            at = x + 0.36 * (k - 0.5)
            axis.bar(at, share, 0.34, color=_COLORS[name], label=name if x == 0 else None)
            axis.annotate(f"{share:.0f}", (at, share), ha="center", va="bottom", fontsize=8)
        axis.set_xticks(range(len(shares)), list(shares))
    axis.set_ylim(0, 118)
    axis.set_ylabel("trials in which the arm would move (%)")
    axis.legend(fontsize=8, loc="upper right")
    axis.grid(alpha=0.25, axis="y")


def _lead(axis: Axes, numbers: dict[str, Any]) -> None:
    for name in MODELS:
        lead = np.sort(numbers[name]["lead_s"])[::-1]
        axis.step(lead, 100 * (np.arange(len(lead)) + 1) / len(lead), color=_COLORS[name], label=name)
    axis.set_xlim(left=0)
    axis.set_ylim(0, 102)
    axis.set_xlabel("time before the touch (s)")
    axis.set_ylabel("touched taxels above threshold\nfrom then on (%)")
    axis.grid(alpha=0.25)


def _convergence(axis: Axes, numbers: dict[str, Any]) -> None:
    for name in MODELS:
        of = numbers[name]
        axis.plot(of["trials"], of["distance_to_final_map"], "o-", ms=4, color=_COLORS[name], label=name)
    axis.axhline(CLOSE_TO_FINAL, color="0.3", lw=1, ls="--")
    axis.set_xscale("log", base=2)
    axis.set_xticks(STEPS[:-2], [str(n) for n in STEPS[:-2]])
    axis.set_xlabel("trials learned")
    axis.set_ylabel("mean difference to the map of all trials")
    axis.grid(alpha=0.25)

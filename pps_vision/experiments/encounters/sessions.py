"""R's last sessions, simulated: an octopus approaches forearm and palm alternately, in avoidance and in reaching."""

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import chain
from typing import Any, get_args

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from control.arm import ArmParams
from control.limits import MAX_HOLD_S
from pps_vision.app.encounters.encounter import (
    Aim,
    Condition,
    Encounter,
    EncounterScene,
    Part,
    draw_visible,
    start_posture,
)
from pps_vision.app.encounters.kinematic import EncounterResult, FrameLog, simulate_encounter
from pps_vision.app.encounters.registry import RADIUS_M, Entry, ours
from pps_vision.app.encounters.tracks import track_of
from pps_vision.app.encounters.training import Memories, learn
from pps_vision.app.intervals import percent_of
from pps_vision.app.simulation import PERIOD_S, SPEED_M_S, Side
from pps_vision.experiments.charts import panels
from pps_vision.experiments.encounters import controllers
from pps_vision.experiments.encounters.reaching import HOLD_S, ours_reaching
from pps_vision.experiments.tables import Table, estimate
from pps_vision.robot.model import Robot
from pps_vision.types import Array
from rendering.stimuli import make_stimulus

THRESHOLD = 0.4  # R: only frames in which some activation exceeds it were recorded
_PARTS: tuple[tuple[Side, Part], ...] = (("left", "inner forearm"), ("right", "palm"))
_WRIST_AT_REST = ArmParams(resting=3)
WRIST_AT_REST = "ours, wrist at rest"
"""The three joints of the wrist at rest, as R's robot moved."""
_DISTANCE_ONLY = "distance only"
_CONTROLLERS = {
    WRIST_AT_REST: Entry(partial(ours, numbers={"arm": _WRIST_AT_REST})),
    _DISTANCE_ONLY: controllers.COMPARED[_DISTANCE_ONLY],
}
_SHOWN = 3  # approaches drawn of each part
_EVERY = round(0.25 / PERIOD_S)  # frames between the kept positions of the palm
_COLOURS = {"avoidance": "tab:red", "reaching": "tab:blue"}  # as R's
_LINKS = {
    "torso": (("root", "lower_torso", "chest", "neck_1", "head"), "0.5"),
    "left arm": (("chest", "left_shoulder_1", "left_upper_arm", "left_lower_arm", "left_hand", "left_palm"), "pink"),
    "right arm": (
        ("chest", "right_shoulder_1", "right_upper_arm", "right_lower_arm", "right_hand", "right_palm"),
        "lightblue",
    ),
    "left eye": (("head", "eyes", "left_eye"), "gold"),
    "right eye": (("head", "eyes", "right_eye"), "gold"),
}
"""Frames from root to tip, and colours (R S1 Fig)."""


def run(study: Any) -> dict[str, Any]:
    """Return counts and ranges of each session, the palms' paths, and the first approaches frame by frame."""
    scene = EncounterScene()
    memories = {side: learn(scene, side, study.seed, study.share) for side in get_args(Side)}
    sessions: dict[str, tuple[Condition, str, float]] = {
        "avoidance": ("stop", WRIST_AT_REST, study.avoidance_min),
        "reaching": ("reach", WRIST_AT_REST, study.reaching_min),
        "distance only": ("stop", _DISTANCE_ONLY, study.avoidance_min),
    }
    posture = scene.robot.at(_start(scene.robot))
    resting_m = {name: [posture.point(f).round(3).tolist() for f in frames] for name, (frames, _) in _LINKS.items()}
    return {"rest_m": resting_m} | {
        name: session(scene, memories, condition, controller, 60 * study.share * minutes, study.seed)
        for name, (condition, controller, minutes) in sessions.items()
    }


def session(
    scene: EncounterScene,
    memories: Mapping[Side, Memories],
    condition: Condition,
    controller: str,
    seconds: float,
    seed: int,
) -> dict[str, Any]:
    """Return counts and ranges of a session of approaches that alternate between the arms."""
    rng = np.random.default_rng((seed, condition == "reach"))
    logs: dict[Side, list[list[FrameLog]]] = {side: [] for side in get_args(Side)}
    results: list[EncounterResult] = []
    t = 0.0
    while t < seconds:
        side, part = _PARTS[len(results) % 2]
        encounter = _approach(scene, condition, side, part, rng, len(results))
        frames: list[FrameLog] = []
        tracks = track_of(scene, encounter, rng)
        entry = _CONTROLLERS[controller]
        new, hold_s = entry.new, MAX_HOLD_S
        if condition == "reach":
            new, hold_s = partial(ours_reaching, arm=_WRIST_AT_REST), HOLD_S
        arguments = entry.memory_of(memories[side]), encounter, controller, new, tracks, frames
        results.append(simulate_encounter(scene, *arguments, field=entry.field, hold_s=hold_s))
        logs[side].append([frame._replace(t_s=frame.t_s + t) for frame in frames])
        t += encounter.seconds
    paths = {side: [_path(scene.robot, side, log) for log in logs[side]] for side in logs}
    return {
        "approaches": len(results),
        "touched": sum(result.touched for result in results),
        "by the part aimed at": sum(result.touched_part == result.part for result in results),
        "arms": {side: ranges(scene, side, logs[side]) for side in logs},
        "paths_mm": paths if controller == WRIST_AT_REST else {},
        "frames": {side: [_shown(log) for log in logs[side][:_SHOWN]] for side in logs},
    }


def _approach(
    scene: EncounterScene, condition: Condition, side: Side, part: Part, rng: np.random.Generator, number: int
) -> Encounter:
    """Draw the octopus's next approach to an arm that awaits it."""
    skin = scene.skins[side]
    posture = scene.robot.at(_start(scene.robot))
    radius_m = make_stimulus("octopus", fineness=0).radius_m
    while True:
        taxel = int(rng.choice(scene.taxels(side, part)))
        aim = Aim(skin, posture, taxel, radius_m, float(rng.uniform(*SPEED_M_S)), rng)
        if encounter := draw_visible(scene, aim, condition, side, part, "octopus", number):
            return encounter


def _start(robot: Robot) -> Array:
    """Posture (n_joints,) of both arms that awaits the octopus."""
    q = start_posture(robot, "inner")
    right = robot.indices(robot.names.arm("right"))
    q[right] = start_posture(robot, "palm")[right]
    return q


def _path(robot: Robot, side: Side, frames: Sequence[FrameLog]) -> list[list[int]]:
    """Positions of the palm (mm) four times a second while an activation exceeds the threshold."""
    active = [frame for frame in frames[::_EVERY] if frame.activations.max() > THRESHOLD]
    palm = robot.names.palm(side)
    return [np.rint(1000 * robot.at(frame.q_rad).point(palm)).astype(int).tolist() for frame in active]


def ranges(scene: EncounterScene, side: Side, logs: Sequence[Sequence[FrameLog]]) -> dict[str, Any]:
    """Return ranges of joints and palm while an activation exceeded the threshold; NaN where none did."""
    frames = [frame for log in logs for frame in log if frame.activations.max() > THRESHOLD]
    if not frames:
        return {"joints_deg": [[np.nan] * 7] * 2, "palm_m": [[np.nan] * 3] * 2, "farthest_m": 0.0}
    palm = scene.robot.names.palm(side)
    start = scene.robot.at(logs[0][0].q_rad).point(palm)
    joints = np.rad2deg([frame.q_rad[scene.arm(side)] for frame in frames])
    positions = np.array([scene.robot.at(frame.q_rad).point(palm) for frame in frames])
    return {
        "joints_deg": [joints.min(axis=0).round(2).tolist(), joints.max(axis=0).round(2).tolist()],
        "palm_m": [positions.min(axis=0).round(3).tolist(), positions.max(axis=0).round(3).tolist()],
        "farthest_m": float(np.linalg.norm(positions - start, axis=1).max()),
    }


def _shown(frames: Sequence[FrameLog]) -> dict[str, Any]:
    """Numbers of an approach's panels."""
    return {
        "t_s": [round(frame.t_s, 2) for frame in frames],
        "distance_m": np.round([frame.distance_m for frame in frames], 4).tolist(),
        "activations": np.round([frame.activations for frame in frames], 3).tolist(),
        "speed_m_s": np.round([frame.speed_m_s for frame in frames], 4).tolist(),
        "touching": [bool(frame.touching) for frame in frames],
    }


def chart(numbers: dict[str, Any]) -> dict[str, Figure]:
    """Draw R Figs 10, 11 and S2 (distance and speed above, activation and touch below), and the palms' paths (S1)."""
    figures = {"paths": _paths(numbers)}
    for name in ("avoidance", "reaching", "distance only"):
        figure, axes = panels(4, 2, height=2.6)
        for k, (side, approaches) in enumerate(numbers[name]["frames"].items()):
            _panel(axes[k], axes[2 + k], approaches, f"{side} {dict(_PARTS)[side]}")
        figures[name.replace(" ", "_")] = figure
    return figures


def _panel(above: Axes, below: Axes, approaches: Sequence[dict[str, Any]], title: str) -> None:
    speed = above.twinx()
    for approach in approaches:
        t = approach["t_s"]
        above.set_prop_cycle(None)  # a taxel has one colour
        below.set_prop_cycle(None)
        above.plot(t, 100 * np.array(approach["distance_m"]), lw=0.8)
        speed.fill_between(t, 100 * np.array(approach["speed_m_s"]), color="tab:purple", alpha=0.25, lw=0)
        below.plot(t, approach["activations"], lw=0.8)
        below.fill_between(t, np.array(approach["touching"], dtype=float), color="tab:green", alpha=0.3, lw=0)
    for axis in (above, below):
        axis.grid(alpha=0.25)
    below.axhline(THRESHOLD, color="0.3", lw=0.8, ls="--")
    above.set(title=title, ylabel="distance to taxels (cm)", ylim=(0, 30))
    speed.set(ylabel="speed (cm/s)", ylim=(0, 20))
    below.set(xlabel="time (s)", ylabel="activation", ylim=(0, 1.02))


def _paths(numbers: Mapping[str, Any]) -> Figure:
    """Draw the palms' paths about the robot at rest, and their spheres, from behind and from above."""
    figure, axes = panels(2, width=5.0, height=4.6)
    links = {name: np.array(points) for name, points in numbers["rest_m"].items()}
    angles = np.linspace(0, 2 * np.pi, 60)
    circle = RADIUS_M * np.column_stack([np.cos(angles), np.sin(angles)])
    for axis, plane, title in zip(axes, ([1, 2], [1, 0]), ("from behind", "from above"), strict=True):
        for name, points in links.items():
            axis.plot(*points[:, plane].T, color=_LINKS[name][1], lw=4, alpha=0.9)
        for name, colour in _COLOURS.items():
            for path in filter(None, chain(*numbers[name]["paths_mm"].values())):
                axis.plot(*np.array(path)[:, plane].T / 1000, color=colour, lw=0.5, alpha=0.8)
            axis.plot([], [], color=colour, label=name)
        for side in get_args(Side):
            axis.plot(*(links[f"{side} arm"][-1, plane] + circle).T, color="0.6", lw=0.8)
        axis.plot([], [], color="0.6", lw=0.8, label=f"{RADIUS_M:g} m from rest")
        axis.set(xlabel="y (m)", ylabel=f"{'xyz'[plane[1]]} (m)", title=title, aspect="equal")
        axis.grid(alpha=0.25)
    axes[0].legend(fontsize=7, loc="upper left")
    axes[1].invert_yaxis()  # the robot looks along −x
    return figure


def table(numbers: dict[str, Any]) -> Table:
    rows = []
    for name in ("avoidance", "reaching", "distance only"):
        cell = numbers[name]
        shares = (estimate(percent_of(cell[key], cell["approaches"])) for key in ("touched", "by the part aimed at"))
        farthest_m = max(arm["farthest_m"] for arm in cell["arms"].values())
        rows.append([name, str(cell["approaches"]), *shares, f"{farthest_m:.3f}"])
    header = ["session", "approaches", "touched (%)", "by the part aimed at (%)", "palm from rest (m)"]
    return Table(header, rows)

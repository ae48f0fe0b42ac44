"""R's last sessions, simulated: an octopus approaches forearm and palm in turn, 20 min of avoidance, 10 of reaching."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, get_args

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from control.fixation import gaze_at
from pps_vision.app.encounters.controllers import RADIUS_M, felt_by_distance
from pps_vision.app.encounters.encounter import Arena, Condition, Encounter, Part, draw_path
from pps_vision.app.encounters.kinematic import Frame, meet
from pps_vision.app.encounters.postures import start_posture
from pps_vision.app.encounters.registry import WRIST_AT_REST, new_controller
from pps_vision.app.encounters.tracks import track_of
from pps_vision.app.encounters.training import Memories, learn
from pps_vision.app.simulation import PERIOD_S, SPEED_M_S, Side, can_follow
from pps_vision.experiments.charts import panels
from pps_vision.experiments.study import SeededStudy, percent_of
from pps_vision.experiments.tables import Table, estimate
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import INNER_FOREARM
from pps_vision.types import Array
from rendering.stimuli import make_stimulus

THRESHOLD = 0.4  # R: only what happens while some activation exceeds it was recorded
JOINTS = ("s0", "s1", "s2", "e0", "w0", "w1", "w2")
PAPER_JOINTS_DEG = {
    "left": ((-65.0, 19.5, -39.2, 16.3, -0.88, -0.015, -0.025), (7.1, 64.2, 80.1, 106.0, 1.38, 0.064, 0.063)),
    "right": ((-61.7, 18.6, -37.8, 15.5, -1.57, -0.079, -0.085), (7.9, 45.5, 80.7, 80.5, 0.86, 0.111, 0.159)),
}
"""Smallest and largest joint angles (R Table 6)."""
PAPER_POSITIONS_M = {
    "left": ((-0.34, -0.39, -0.06), (-0.18, 0.00, 0.15)),
    "right": ((-0.34, 0.06, -0.03), (-0.19, 0.36, 0.10)),
}
"""Smallest and largest positions of the hand (R Table 7)."""
_PARTS: tuple[tuple[Side, Part], ...] = (("left", "inner forearm"), ("right", "palm"))
_SHOWN = 3  # approaches drawn of each part
_DISTANCE_ONLY = "distance only"
_EVERY = round(0.25 / PERIOD_S)  # frame of which the palm's place is kept
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


@dataclass(frozen=True)
class EncountersSessions(SeededStudy):
    """R's sessions of avoidance and reaching with ours, the wrist at rest (Figs 10, 11, S1, Tables 6, 7), and of
    avoidance with distance only (after S2 Fig): an octopus at 5–15 cm/s, left inner forearm and right palm in turn."""

    SHORT: ClassVar[Mapping[str, Any]] = {"share": 0.01}

    avoidance_min: float = 20.0
    """Length of the session of avoidance, and of the one with distance only."""
    reaching_min: float = 10.0
    """Length of the session of reaching."""
    share: float = 1.0
    """Share of R's numbers of approaches that the memories are learned from, and of the sessions' lengths."""

    def run(self) -> dict[str, Any]:
        """Return counts and ranges of each session, the palms' paths, and the first approaches frame by frame."""
        arena = Arena()
        memories = {side: learn(arena, side, self.seed, self.share) for side in get_args(Side)}
        sessions: dict[str, tuple[Condition, str, float]] = {
            "avoidance": ("stop", WRIST_AT_REST, self.avoidance_min),
            "reaching": ("reach", WRIST_AT_REST, self.reaching_min),
            "distance only": ("stop", _DISTANCE_ONLY, self.avoidance_min),
        }
        found = {
            name: self._session(arena, memories, condition, controller, 60 * self.share * minutes)
            for name, (condition, controller, minutes) in sessions.items()
        }
        return {"rest_m": _at_rest(arena.robot), **found}

    def _session(
        self, arena: Arena, memories: dict[Side, Memories], condition: Condition, controller: str, seconds: float
    ) -> dict[str, Any]:
        rng, t, number = np.random.default_rng((self.seed, condition == "reach")), 0.0, 0
        by_side: dict[Side, list[list[Frame]]] = {"left": [], "right": []}
        outcomes = []
        while t < seconds:
            side, part = _PARTS[number % 2]
            encounter = _approach(arena, condition, side, part, rng, number)
            frames: list[Frame] = []
            tracks, new = track_of(arena, encounter, rng), new_controller(controller)
            outcomes.append(meet(arena, memories[side], encounter, controller, new, tracks, frames))
            if controller == _DISTANCE_ONLY:  # others than those of D and TTC move this arm
                skin, memory, q = arena.skins[side], memories[side].of_distance, encounter.q_rad
                for k, track in enumerate(tracks):
                    felt = felt_by_distance(skin, memory, track, arena.robot.at(q))
                    q, frames[k] = frames[k].q_rad, frames[k]._replace(activations=felt)
            by_side[side].append([frame._replace(t_s=frame.t_s + t) for frame in frames])
            t, number = t + encounter.seconds, number + 1
        return {
            "minutes": t / 60,
            "approaches": len(outcomes),
            "answered": sum(one.commands > 0 for one in outcomes),
            "touched": sum(one.touched for one in outcomes),
            "by the part aimed at": sum(one.touched_part == one.part for one in outcomes),
            "limits left": sum(bool(one.faults) for one in outcomes),
            "arms": {side: _ranges(arena, side, of) for side, of in by_side.items()},
            "paths_mm": {side: [_path(arena.robot, side, of) for of in some] for side, some in by_side.items()}
            if controller == WRIST_AT_REST
            else {},
            "frames": {side: [_drawn(of) for of in some[:_SHOWN]] for side, some in by_side.items()},
        }

    def chart(self, numbers: dict[str, Any]) -> dict[str, Figure]:
        """Draw the panels of R Figs 10, 11 and S2, distance and speed above, activation and touch below; and the palms'
        paths of S1."""
        figures = {"paths": _paths(numbers)}
        for name in ("avoidance", "reaching", "distance only"):
            figure, axes = panels(4, 2, height=2.6)
            for k, (side, approaches) in enumerate(numbers[name]["frames"].items()):
                _panel(axes[k], axes[2 + k], approaches, f"{side} {dict(_PARTS)[side]}")
            figures[name.replace(" ", "_")] = figure
        return figures

    def tables(self, numbers: dict[str, Any]) -> dict[str, Table]:
        """Return what became of the approaches, and R's Tables 6 and 7 with the paper's values."""
        counted = ["answered", "touched", "by the part aimed at"]
        sessions = {name: of for name, of in numbers.items() if isinstance(of, dict) and "approaches" in of}
        both = [sessions["avoidance"], sessions["reaching"]]
        joints, positions = [], []
        for side in get_args(Side):
            joints += _rows(side, "joints_deg", both, PAPER_JOINTS_DEG[side], 1)
            positions += _rows(side, "palm_m", both, PAPER_POSITIONS_M[side], 2)
        return {
            "": Table(
                [
                    *("session", "minutes", "approaches", *(f"{what} (%)" for what in counted)),
                    *("limits left", "palm from its place at most (m)"),
                ],
                [
                    [
                        *(name, f"{of['minutes']:.3g}", str(of["approaches"])),
                        *(f"{of[key]}: {estimate(percent_of(of[key], of['approaches']))}" for key in counted),
                        str(of["limits left"]),
                        f"{max(a['farthest_m'] for a in of['arms'].values()):.3f}",
                    ]
                    for name, of in sessions.items()
                ],
            ),
            "joints": Table(["range (°)", *JOINTS], joints),
            "positions": Table(["range (m)", "x", "y", "z"], positions),
        }


def _approach(
    arena: Arena, condition: Condition, side: Side, part: Part, rng: np.random.Generator, number: int
) -> Encounter:
    """Draw the octopus's next approach to an arm that awaits it at home."""
    robot, skin = arena.robot, arena.skins[side]
    q = _awaiting(robot)
    radius = make_stimulus("octopus", fineness=0).radius_m
    ids = skin.parts[1].ids if part == "palm" else INNER_FOREARM
    while True:
        taxel = f"{side}_{'palm' if part == 'palm' else 'forearm'}:{rng.choice(ids)}"
        speed = float(rng.uniform(*SPEED_M_S))
        motion, seconds, contact_s = draw_path(condition)(arena, skin, q, skin.index(taxel), radius, speed, rng)
        q_start = gaze_at(robot, q, motion(0.0)[0])
        until_s = min(seconds, contact_s)
        if can_follow(robot, arena.rig, q_start, motion, until_s, 3) and arena.shows(q_start, motion, radius, until_s):
            what = side, part, taxel, "octopus", radius, speed, motion, seconds, contact_s, q_start
            return Encounter(number, condition, *what)  # type: ignore[arg-type]


def _awaiting(robot: Robot) -> Array:
    """Return the posture (n_joints,) that awaits the octopus."""
    q, right = start_posture(robot, "inner"), robot.indices(robot.names.arm("right"))
    q[right] = start_posture(robot, "palm")[right]
    return q


def _at_rest(robot: Robot) -> dict[str, list[list[float]]]:
    """Return the points of each of `_LINKS` in that posture, m."""
    posture = robot.at(_awaiting(robot))
    return {name: [posture.point(f).round(3).tolist() for f in frames] for name, (frames, _) in _LINKS.items()}


def _path(robot: Robot, side: Side, frames: Sequence[Frame]) -> list[list[int]]:
    """Return where the palm is while an activation exceeds the threshold, mm, four times a second of an approach."""
    active = [frame for frame in frames[::_EVERY] if frame.activations.max() > THRESHOLD]
    palm = robot.names.palm(side)
    return [np.rint(1000 * robot.at(frame.q_rad).point(palm)).astype(int).tolist() for frame in active]


def _ranges(arena: Arena, side: Side, approaches: Sequence[Sequence[Frame]]) -> dict[str, Any]:
    """Return ranges of joints and palm while an activation exceeded the threshold."""
    frames = [frame for of in approaches for frame in of if frame.activations.max() > THRESHOLD]
    if not frames:
        nothing = {"joints_deg": [[np.nan] * 7] * 2, "palm_m": [[np.nan] * 3] * 2}
        return {**nothing, "farthest_m": 0.0}
    palm = arena.robot.names.palm(side)
    start = arena.robot.at(approaches[0][0].q_rad).point(palm)
    joints = np.rad2deg([frame.q_rad[arena.arm(side)] for frame in frames])
    positions = np.array([arena.robot.at(frame.q_rad).point(palm) for frame in frames])
    return {
        "joints_deg": [joints.min(axis=0).round(2).tolist(), joints.max(axis=0).round(2).tolist()],
        "palm_m": [positions.min(axis=0).round(3).tolist(), positions.max(axis=0).round(3).tolist()],
        "farthest_m": float(np.linalg.norm(positions - start, axis=1).max()),
    }


def _rows(
    side: str, key: str, sessions: Sequence[dict[str, Any]], paper: Sequence[Any], digits: int
) -> list[list[str]]:
    """Return rows of smallest, largest and range over the sessions, ours and the paper's."""
    low = np.min([of["arms"][side][key][0] for of in sessions], axis=0)
    high = np.max([of["arms"][side][key][1] for of in sessions], axis=0)
    rows = []
    for what, ours, theirs in (("min", low, paper[0]), ("max", high, paper[1])):
        cells = [f"{a:.{digits}f} ({b:g})" for a, b in zip(ours, theirs, strict=True)]
        rows.append([f"{side}, {what} (R)", *cells])
    width = np.array(paper[1]) - np.array(paper[0])
    return [
        *rows,
        [f"{side}, range (R)", *(f"{a:.{digits}f} ({b:.3g})" for a, b in zip(high - low, width, strict=True))],
    ]


def _drawn(frames: Sequence[Frame]) -> dict[str, Any]:
    """Return what the panels show of an approach."""
    return {
        "t_s": [round(frame.t_s, 2) for frame in frames],
        "distance_m": np.round([frame.distance_m for frame in frames], 4).tolist(),
        "activations": np.round([frame.activations for frame in frames], 3).tolist(),
        "speed_m_s": np.round([frame.speed_m_s for frame in frames], 4).tolist(),
        "touching": [bool(frame.touching) for frame in frames],
    }


def _panel(above: Axes, below: Axes, approaches: Sequence[dict[str, Any]], title: str) -> None:
    speed = above.twinx()
    for of in approaches:
        t = of["t_s"]
        above.set_prop_cycle(None)  # a taxel has one colour
        below.set_prop_cycle(None)
        above.plot(t, 100 * np.array(of["distance_m"]), lw=0.8)
        speed.fill_between(t, 100 * np.array(of["speed_m_s"]), color="tab:purple", alpha=0.25, lw=0)
        below.plot(t, of["activations"], lw=0.8)
        below.fill_between(t, np.array(of["touching"], dtype=float), color="tab:green", alpha=0.3, lw=0)
    for axis in (above, below):
        axis.grid(alpha=0.25)
    below.axhline(THRESHOLD, color="0.3", lw=0.8, ls="--")
    above.set(title=title, ylabel="distance to taxels (cm)", ylim=(0, 30))
    speed.set(ylabel="speed (cm/s)", ylim=(0, 20))
    below.set(xlabel="time (s)", ylabel="activation", ylim=(0, 1.02))


def _paths(numbers: Mapping[str, Any]) -> Figure:
    """Draw the palms' paths about the robot at rest and the spheres that they are to stay in (R S1 Fig): in
    perspective, from behind and from above."""
    figure = Figure((13.5, 4.6), layout="constrained")
    space = figure.add_subplot(1, 3, 1, projection="3d")
    planes = {figure.add_subplot(1, 3, 2): (1, 2), figure.add_subplot(1, 3, 3): (1, 0)}
    rest = {name: np.array(points) for name, points in numbers["rest_m"].items()}
    lines: list[tuple[Array, dict[str, Any]]] = [
        (points, {"color": _LINKS[name][1], "lw": 4, "alpha": 0.9}) for name, points in rest.items()
    ]
    for session, colour in _COLOURS.items():
        paths = (np.array(path) / 1000 for of in numbers[session]["paths_mm"].values() for path in of if path)
        lines += [(path, {"color": colour, "lw": 0.5, "alpha": 0.8}) for path in paths]
    for points, style in lines:
        space.plot(*points.T, **style)
        for plane, axes in planes.items():
            plane.plot(*points[:, axes].T, **style)
    around = np.linspace(0, 2 * np.pi, 60)
    cos, sin, zero = np.cos(around), np.sin(around), np.zeros(60)
    for center in (rest[f"{side} arm"][-1] for side in get_args(Side)):
        for circle in ((cos, sin, zero), (zero, cos, sin), (cos, zero, sin)):
            space.plot(*(center[:, None] + RADIUS_M * np.array(circle)), color="0.6", lw=0.6)
        for plane, (across, up) in planes.items():
            plane.plot(center[across] + RADIUS_M * cos, center[up] + RADIUS_M * sin, color="0.6", lw=0.8)
    for session, colour in _COLOURS.items():
        space.plot([], [], color=colour, label=session)
    space.plot([], [], color="0.6", lw=0.8, label=f"{RADIUS_M:g} m from rest")
    space.legend(fontsize=7, loc="upper left")
    space.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)")
    space.set_aspect("equal")
    space.locator_params(nbins=4)
    space.view_init(elev=20, azim=-150)
    for plane, axes, name in zip(planes, planes.values(), ("from behind", "from above"), strict=True):
        plane.set(xlabel=f"{'xyz'[axes[0]]} (m)", ylabel=f"{'xyz'[axes[1]]} (m)", title=name, aspect="equal")
        plane.grid(alpha=0.25)
    list(planes)[1].invert_yaxis()  # the robot looks along −x
    return figure

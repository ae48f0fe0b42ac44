"""A hand and a walking person of cylinders and balls: shown beside a film's objects, without truth."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from pps_vision.experiments.films.caster import Ball, Cylinder, Levels, Paint, Solid, Solids
from pps_vision.types import Array

SKIN: Levels = (200.0, 150.0, 120.0)
_HAIR: Levels = (60.0, 45.0, 35.0)
_EYE_HEIGHT_M = 1.15  # height of the cameras above the floor
_FINGER_M = 0.008  # radius
_STEP_RAD_S = 5.5
_UP = np.array([0.0, -1.0, 0.0])
_FRONT = np.array([0.0, 0.0, -1.0])


def limb(joints: list[Array], radius_m: float, color: Levels) -> list[Solid]:
    """Return balls on the joints (3,) and cylinders between them."""
    paint = Paint(color)
    bones = [Cylinder(0.5 * (p + q), 0.5 * (q - p), radius_m, paint) for p, q in pairwise(joints)]
    return [*(Ball(p, radius_m, paint) for p in joints), *bones]


def make_hand(rng: np.random.Generator) -> Callable[[Array, float, float], Solids]:
    """Return a right or left hand from below that holds a ball, its fingers in front.

    Its arguments are the ball's centre (3,) and radius and how far the hand is away, back along the arm (m).
    """
    angle = rng.uniform(-0.7, 0.7)
    to_wrist = np.array([np.sin(angle), np.cos(angle), 0.0])
    side = rng.choice([-1.0, 1.0]) * np.cross(_FRONT, to_wrist)  # towards the thumb
    reaches = np.deg2rad(rng.uniform(40, 80, 4))  # reach of the fingers around the ball

    def hand(center: Array, radius_m: float, away_m: float) -> Solids:
        origin = center + away_m * to_wrist
        rim = radius_m + _FINGER_M
        wrist = origin + (radius_m + 0.085) * to_wrist - 0.015 * _FRONT
        solids: list[Solid] = []
        for along, reach in zip(rim * np.array([-0.68, -0.23, 0.23, 0.68]), reaches, strict=True):
            around = np.sqrt(rim**2 - along**2)
            turns = [np.cos(turn) * to_wrist + np.sin(turn) * _FRONT for turn in (0, 0.5 * reach, reach)]
            finger = [origin + along * side + around * turn for turn in turns]
            solids += limb([wrist + 0.5 * along * side, finger[0]], 1.7 * _FINGER_M, SKIN)
            solids += limb(finger, _FINGER_M, SKIN)
        base = wrist + 0.025 * side - 0.035 * to_wrist + 0.01 * _FRONT
        beside = origin + rim * (0.85 * side + 0.5 * to_wrist + 0.15 * _FRONT)
        tip = origin + rim * (0.88 * side - 0.05 * to_wrist + 0.47 * _FRONT)
        elbow = wrist + 0.6 * to_wrist - 0.2 * _FRONT
        return (*solids, *limb([wrist, base, beside, tip], 1.15 * _FINGER_M, SKIN), *limb([wrist, elbow], 0.026, SKIN))

    return hand


def make_person(rng: np.random.Generator) -> Callable[[float], Solids]:
    """Return a person, 1.72 m tall, by time: walking across the view from either side, or away."""
    side = rng.choice([-1.0, 1.0])
    z = rng.uniform(2.0, 2.8)
    begin = np.array([-0.6 * z * side, _EYE_HEIGHT_M, z])
    velocity = np.array([0.7 * side, 0, rng.uniform(-0.1, 0.1)])
    if rng.random() < 0.5:
        begin = np.array([0.2 * z * side, _EYE_HEIGHT_M, 1.9])
        velocity = np.array([rng.uniform(-0.1, 0.1), 0, 0.5])
    shirt, trousers = ((r, g, b) for r, g, b in rng.uniform(30, 220, (2, 3)).tolist())
    phase = rng.uniform(0, 2 * np.pi)
    ahead = velocity / np.linalg.norm(velocity)
    across = np.cross(ahead, _UP)

    def swung(angle: float) -> Array:
        return np.asarray(np.sin(angle) * ahead - np.cos(angle) * _UP)

    def person(t_s: float) -> Solids:
        floor = begin + t_s * velocity
        shoulders = floor + 1.38 * _UP
        head = floor + 1.61 * _UP
        hair = Ball(head + 0.025 * _UP - 0.02 * ahead, 0.1, Paint(_HAIR))
        solids = [Ball(head, 0.1, Paint(SKIN)), hair, *limb([shoulders, head], 0.05, SKIN)]
        step = phase + _STEP_RAD_S * t_s
        for side in (-1, 1):
            swing = side * 0.45 * np.sin(step)
            hip = floor + 0.9 * _UP + 0.08 * side * across
            knee = hip + 0.43 * swung(swing)
            ankle = knee + 0.43 * swung(swing - 0.35 * (1 + side * np.cos(step)))
            shoulder = shoulders + 0.19 * side * across
            elbow = shoulder + 0.3 * swung(-swing)
            solids += limb([hip, knee, ankle], 0.065, trousers)
            solids += limb([hip + 0.05 * _UP, shoulders - 0.05 * _UP + 0.07 * side * across], 0.115, shirt)
            solids += limb([shoulder, elbow], 0.05, shirt)
            solids += limb([elbow, elbow + 0.26 * swung(0.4 - swing)], 0.04, SKIN)
        return tuple(solids)

    return person

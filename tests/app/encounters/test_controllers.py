"""An engineer's gates about our controller."""

import numpy as np
import pytest
from tracks import track_at

from pps_vision.app.encounters.encounter import EncounterScene
from pps_vision.app.encounters.registry import ArmScene, gated
from pps_vision.robot.icub import home

BALL_M = 0.035
DT = 0.05
SCENE = EncounterScene()
RECEDES = [0.07 + min(0.01 * i, 0.05) for i in range(10)]  # and stops


@pytest.mark.parametrize(
    ("distances_m", "aside_m", "velocity_m_s", "responds"),
    [
        # at 10 cm/s along the normal, or past the skin
        ([0.165 - 0.1 * DT * i for i in range(6)], 0.0, -0.1, True),
        ([0.165 - 0.1 * DT * i for i in range(6)], 0.15, -0.1, False),
        # a centimetre nearer than half a second ago, by positions; the estimated velocity, of zero, does not count
        ([0.1 - 0.018 * i * DT for i in range(20)], 0.0, 0.0, False),
        ([0.1 - 0.024 * i * DT for i in range(20)], 0.0, 0.0, True),
        # an object that recedes and stops, though its estimated velocity points back; then it comes
        (RECEDES, 0.0, -0.02, False),
        (RECEDES + [0.12 - 0.01 * i for i in range(4)], 0.0, -0.02, True),
    ],
)
def test_a_gated_arm_at_rest_responds_to_what_comes_and_not_to_what_passes(
    distances_m, aside_m, velocity_m_s, responds
):
    q = home(SCENE.robot)
    posture = SCENE.robot.at(q)
    skin = SCENE.skins["left"]
    points, normals = skin.at(posture)
    k = skin.index("left_forearm:27")
    forearm = points[skin.part_index == skin.part_index[k]]
    aside = np.cross(normals[k], forearm.mean(axis=0) - posture.point("left_palm"))
    aside *= aside_m * np.sign((points[k] - forearm.mean(axis=0)) @ aside) / np.linalg.norm(aside)
    act = gated(ArmScene(SCENE.robot, skin, "left", q, SCENE.self_collision))
    activations = 0.9 * (np.arange(len(points)) == k)
    moves = []
    for i, distance_m in enumerate(distances_m):
        center = points[k] + aside + (BALL_M + distance_m) * normals[k]
        track = track_at(center, velocity_m_s * normals[k], stamp_s=i * DT, radius_m=BALL_M)
        moves.append(act(activations, track, posture).any())
    assert any(moves) == responds

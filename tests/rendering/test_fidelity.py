"""What more samples, triangles, lamps and shadows do to the image; and choosing by an error that is asked for."""

from dataclasses import replace

import numpy as np
import pytest

from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.model import Robot
from pps_vision.types import Array
from rendering.eyes import Eyes
from rendering.fidelity import MEASURED, Fidelity, cheapest
from rendering.scene import Placed, SceneState
from rendering.shapes import board
from rendering.stimuli import make_stimulus

PLACE = np.array([-0.36, -0.06, 0.12])
FINEST = Fidelity(supersample=4, fineness=4)


def drawn(robot: Robot, rig: StereoRig, state: SceneState, fidelity: Fidelity) -> Array:
    stimulus = make_stimulus("ball", fineness=fidelity.fineness)
    with Eyes(robot, rig, stimulus, fidelity=fidelity, props=((board(0.1, 0.1),),)) as eyes:
        return eyes.render(state, 0.0).left.astype(float)


def test_each_refinement_comes_nearer_to_the_finest(robot: Robot, rig: StereoRig, q: Array) -> None:
    state = SceneState(q, PLACE)
    best = drawn(robot, rig, state, FINEST)

    def error(fidelity: Fidelity) -> float:
        return float(np.sqrt(np.mean((drawn(robot, rig, state, fidelity) - best) ** 2)))

    usual = error(Fidelity())
    assert error(Fidelity(multisample=False)) > usual
    assert error(Fidelity(fineness=1)) > 2 * usual
    assert error(Fidelity(supersample=2)) < usual
    assert error(replace(FINEST, supersample=3)) < 0.5 * usual


def test_a_lamp_lights_what_faces_it_by_lamberts_law(robot: Robot, rig: StereoRig, q: Array) -> None:
    up, red = np.array([0.474, 0.237, 0.848]), 0.95 * 255
    eye = rig.view(q).left
    toward_eye = eye.center - PLACE
    toward_eye /= np.linalg.norm(toward_eye)
    brightness = {}
    for lights in (0, 1, 3):
        image = drawn(robot, rig, SceneState(q, PLACE), Fidelity(fineness=4, lights=lights))[..., 0]
        for aside in (-0.5, 0.0, 0.5):  # of the radius: points of the ball, and the normals there
            normal = aside * eye.T_root_camera[:3, 0] + np.sqrt(1 - aside**2) * toward_eye
            normal /= np.linalg.norm(normal)
            u, v = np.rint(eye.project(PLACE + 0.035 * normal)).astype(int)
            brightness[lights, aside] = image[v, u]
            if lights == 1:
                assert image[v, u] == pytest.approx(red * (0.62 + 0.38 * max(normal @ up, 0)), abs=4)
    assert brightness[0, -0.5] == brightness[0, 0.0] == brightness[0, 0.5]
    assert brightness[3, -0.5] != pytest.approx(brightness[1, -0.5], abs=2)


def test_a_board_casts_its_shadow_away_from_the_lamp(robot: Robot, rig: StereoRig, q: Array) -> None:
    """On the table (z = -0.22 m), where the ray from the lamp (0.474, 0.237, 0.848) through the board ends."""
    up = np.array([0.474, 0.237, 0.848])
    lit = np.array([-0.50, -0.02, -0.22])
    state = SceneState(q, props=(Placed(lit + 0.2 * up),))
    eye = rig.view(q).left
    u, v = np.rint(eye.project(lit)).astype(int)
    assert eye.sees(lit, margin_px=10)
    without, with_shadow = (drawn(robot, rig, state, Fidelity(shadows=s)) for s in (False, True))
    here = np.s_[v - 2 : v + 3, u - 2 : u + 3]
    assert with_shadow[here].mean() < 0.8 * without[here].mean()
    aside = lit + np.array([-0.12, 0.0, 0.0])
    u, v = np.rint(eye.project(aside)).astype(int)
    assert np.abs(with_shadow - without)[v - 2 : v + 3, u - 2 : u + 3].max() <= 1


def test_the_cheapest_that_meets_the_error_is_chosen() -> None:
    costs, errors = [m.cost for m in MEASURED], [m.error_levels for m in MEASURED]
    assert costs == sorted(costs)
    assert errors == sorted(errors, reverse=True)
    assert cheapest(1000.0) is MEASURED[0]
    for dearer, measured in zip(MEASURED[1:], MEASURED, strict=False):
        assert cheapest(measured.error_levels) is measured
        assert cheapest(measured.error_levels - 0.01) is dearer
    with pytest.raises(ValueError, match=r"image error 0.0 grey levels; expected .* or more"):
        cheapest(0.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"supersample": 0}, "expected supersample 1–8"),
        ({"fineness": 7}, "fineness 0–6"),
        ({"lights": 4}, "lights 0–3"),
        ({"lights": 0, "shadows": True}, "a light where there are shadows"),
        ({"blur_step_px": 0.0}, "a positive step"),
        ({"blur_step_px": np.nan}, "a positive step"),
    ],
)
def test_senseless_fidelities_are_refused(change: dict[str, int], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Fidelity(**change)  # type: ignore[arg-type]

"""The tracking table's cases on independent scenes: one name, one scene, one tracker."""

from dataclasses import dataclass, replace

from pps_vision.experiments.independent_films import IndependentScene
from pps_vision.experiments.independent_scenes import PHOTOS, Color
from pps_vision.experiments.sensor_chain import SensorChain
from tracking.marker import MarkerParams
from tracking.tracker import TrackerParams

RED: Color = (205.0, 30.0, 25.0)
GREEN: Color = (25.0, 200.0, 40.0)
BLUE: Color = (25.0, 60.0, 210.0)
GREY: Color = (128.0, 128.0, 128.0)
WHITE: Color = (245.0, 245.0, 245.0)
BLACK: Color = (25.0, 25.0, 25.0)
WHOLE_SENSOR = SensorChain(bayer=True, shot=0.2, jpeg=85)
_VIVID = IndependentScene()


@dataclass(frozen=True)
class Case:
    """`base` filmed over another photograph with every film; tracked as a marker of its hue, or as anything."""

    name: str
    base: IndependentScene
    marker: bool = False

    def scene(self, film: int) -> IndependentScene:
        """Of the film of that number; a textured object never wears the photograph behind it."""
        texture = (film + 2) % len(PHOTOS)
        return replace(self.base, background=film % len(PHOTOS), texture=texture)

    def tracker(self, hue_deg: float) -> TrackerParams:
        """What the object is looked for with."""
        if self.marker:
            return TrackerParams("marker", marker=MarkerParams(hue_deg))
        return TrackerParams()


def _cases() -> tuple[Case, ...]:
    head = replace(_VIVID, rig="head", start="moving", distance_m=0.45, extent_m=0.08, speed_m_s=0.15)
    marker = replace(_VIVID, radius_m=0.012, color=GREEN)
    dull = {"grey": GREY, "white": WHITE, "black": BLACK, "background-coloured": "background"}
    scenes: dict[str, IndependentScene] = {
        "vivid, red": _VIVID,
        "vivid, blue": replace(_VIVID, color=BLUE),
        "vivid, whole sensor chain": replace(_VIVID, sensor=WHOLE_SENSOR, gain_drift=0.1),
        **{f"{name}, entering": replace(_VIVID, color=color) for name, color in dull.items()},  # type: ignore[arg-type]
        "grey, in view from the start": replace(_VIVID, color=GREY, start="rest"),
        "grey image, white, in view from the start": replace(
            _VIVID, color=WHITE, start="rest", sensor=SensorChain(grey=True)
        ),
        "striped, spinning": replace(_VIVID, pattern="striped", spin_rad_s=3.0),
        "chequered, spinning": replace(_VIVID, pattern="chequered", spin_rad_s=3.0),
        "textured square": replace(_VIVID, shape="square", pattern="textured", radius_m=0.04, spin_rad_s=0.3),
        "two balls of one colour": replace(_VIVID, second="same"),
        "rig rotates, declared fixed": replace(_VIVID, rig="rotating"),
        "rig shakes, declared fixed": replace(_VIVID, rig="shaking"),
        "rig rotates, pose known": replace(_VIVID, rig="rotating", rig_known=True),
        "behind a board for 1 s": replace(
            _VIVID, motion="straight", start="moving", seconds=6.0, speed_m_s=0.1, hidden_s=1.0
        ),
        "defocus, sigma 3 px": replace(_VIVID, sensor=SensorChain(defocus_px=3.0)),
        "motion blur, 20 ms": replace(_VIVID, shutter_s=0.02),
        "flicker and gain drift": replace(_VIVID, flicker=0.15, gain_drift=0.2),
        "noise 10": replace(_VIVID, sensor=SensorChain(read_noise=10.0)),
        "2 cm/s": replace(_VIVID, speed_m_s=0.02, start="rest", rest_s=0.5, extent_m=0.04),
        "1 m/s, instant reversal": replace(_VIVID, speed_m_s=1.0, motion="reversal", start="moving"),
        "moves, stops for 2 s, moves on": replace(_VIVID, motion="stop_and_go", start="moving", seconds=5.0),
        "320x240, 10 fps": replace(_VIVID, width=320, height=240, fps=10.0),
        "1280x960, 60 fps": replace(_VIVID, width=1280, height=960, fps=60.0, seconds=2.0, start="moving"),
        **{f"head moves, {ms} ms stale": replace(head, stale_s=ms / 1000) for ms in (0, 10, 20)},
        "head moves, grey": replace(head, color=GREY),
    }
    markers = {
        "marker": marker,
        "marker, whole sensor chain": replace(marker, sensor=WHOLE_SENSOR, gain_drift=0.1),
        "marker, head moves, 20 ms stale": replace(head, radius_m=0.012, color=GREEN, stale_s=0.02),
        "marker, 2 cm/s": replace(scenes["2 cm/s"], radius_m=0.012, color=GREEN),
    }
    return (
        *(Case(name, scene) for name, scene in scenes.items()),
        *(Case(name, scene, marker=True) for name, scene in markers.items()),
    )


CASES = _cases()

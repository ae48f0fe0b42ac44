"""The options of `pps-vision render` and of `pps_vision.render`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rendering.names import CarrierName, MotionName, StimulusName, Unit


@dataclass(frozen=True)
class RenderParams:
    """Write a recording in yarpdatadumper layout, with calibration, touches and truth.csv."""

    stimulus: StimulusName | Path
    """What is shown; or a mesh file, .stl, .obj or .ply."""
    motion: MotionName
    """How it moves; approach and recede are about --target, the others about --center."""
    out: Path
    """Recording folder to write; must be new or empty."""
    target: str = "left_forearm:27"
    """Taxel that an approach is aimed at."""
    center: tuple[float, float, float] | None = None
    """Where the other motions happen, root frame, m; default: random, 0.33 to 0.52 m before the eyes."""
    seconds: float = 5.0
    """Length of the recording."""
    fps: float = 20.0
    """Stereo pairs a second."""
    speed: float | None = None
    """Speed of the object, m/s; default: random, 0.05 to 0.15."""
    radius: float | None = None
    """Radius of the object, m; default: its usual one, or the mesh's own (that of its hull's mean silhouette)."""
    unit: Unit = "m"
    """Unit of a mesh file's coordinates."""
    noise: float = 0.0
    """Standard deviation of the pixel noise, grey levels of 255."""
    shot: float = 0.0
    """Variance of the shot noise per grey level."""
    exposure: float = 1.0
    """Gain; 2 is overexposed, 0.5 underexposed."""
    blur_s: float = 0.0
    """How long the shutter is open, s: motion blur."""
    carrier: CarrierName = "none"
    """Who holds the object."""
    head: Literal["follow", "sway", "still"] = "follow"
    """follow: the eyes fixate the object while the head sways; sway: the head moves by itself; still."""
    scale: float = 1.0
    """Pixels of the drawn pinhole image per pixel of the eye, 0.5 to 2: finer images take longer (`bench stages`)."""
    robot: Path | None = None
    """robot.toml of another robot, with one of its taxels as --target; default: the iCub."""
    seed: int = 0
    """Seed of the motion and the noise."""

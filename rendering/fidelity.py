"""Fidelity of the rendered images: resolution, triangles, light, motion blur."""

from dataclasses import dataclass
from typing import Literal, get_args

from pps_vision.errors import InputError

Lighting = Literal["baked", "lights"]


@dataclass(frozen=True)
class Fidelity:
    """Resolution, triangles and light of the drawn images.

    Args:
        scale: Pixels of the pinhole image per pixel of the eye, along each axis, at the image centre; at most 2,
            because the image is interpolated from 2×2 of them.
        fineness: A ball has 20·4^fineness triangles, a tube 4·(fineness − 1) sides.
        lighting: baked: diffuse light, computed per vertex and stored in the vertex colours; lights: pyrender's
            lights, per pixel, with highlights and gamma.
        blur_step_px: Image motion per image averaged for motion blur; motion below 0.4 of it is not blurred.
    """

    scale: float = 1.0
    fineness: int = 3
    lighting: Lighting = "baked"
    blur_step_px: float = 2.5

    def __post_init__(self) -> None:
        if not (0.5 <= self.scale <= 2 and 0 <= self.fineness <= 6):
            raise InputError("fidelity", f"{self}; expected scale 0.5–2, fineness 0–6")
        if self.lighting not in get_args(Lighting):
            raise InputError("fidelity", f"{self}; expected a lighting of {', '.join(get_args(Lighting))}")
        if not self.blur_step_px > 0:
            raise InputError("fidelity", f"{self}; expected a positive step of the blur")

"""How faithfully a scene is drawn, and what that costs."""

from dataclasses import dataclass
from typing import Literal, get_args

Lighting = Literal["baked", "lights", "shadows"]


@dataclass(frozen=True)
class Fidelity:
    """Resolution, triangles and light of the drawn images.

    Args:
        scale: Pixels of the pinhole image per pixel of the eye, along each axis, at the image centre; at most 2,
            because the image is interpolated from 2×2 of them.
        fineness: A ball has 20·4^fineness triangles, a tube 4·(fineness − 1) sides.
        lighting: baked: diffuse light, computed per vertex and stored in the vertex colours; lights: pyrender's
            lights, per pixel, with highlights and gamma; shadows: the same with its shadow maps.
        blur_step_px: What moves so far while the shutter is open costs a further image to average (what moves
            less than 0.4 of it is drawn sharp).
    """

    scale: float = 1.0
    fineness: int = 3
    lighting: Lighting = "baked"
    blur_step_px: float = 2.5

    def __post_init__(self) -> None:
        if not (0.5 <= self.scale <= 2 and 0 <= self.fineness <= 6):
            raise ValueError(f"{self}; expected scale 0.5–2, fineness 0–6")
        if self.lighting not in get_args(Lighting):
            raise ValueError(f"{self}; expected a lighting of {', '.join(get_args(Lighting))}")
        if not self.blur_step_px > 0:
            raise ValueError(f"{self}; expected a positive step of the blur")


@dataclass(frozen=True)
class Measured:
    """What a way to draw costs, relative to the default's time, and how far its image of a ball or a marker
    (the worse) is from a ray-cast one: RMS grey levels of 255 over the object and two pixels around it."""

    fidelity: Fidelity
    cost: float
    error_levels: float

    def __str__(self) -> str:
        f = self.fidelity
        return (
            f"scale {f.scale:g}, fineness {f.fineness}, lighting {f.lighting}: {self.error_levels} grey levels from a "
            f"ray-cast image, at {self.cost} of the default's time"
        )


# `pps-vision bench fidelity` measures it (seed 0): balls and markers, 0.25–0.6 m before the eyes.
MEASURED = (
    Measured(Fidelity(fineness=2), 0.95, 4.7),
    Measured(Fidelity(), 1.0, 4.5),
    Measured(Fidelity(scale=1.5), 1.7, 3.4),
    Measured(Fidelity(scale=2), 2.7, 1.6),
)


def cheapest(max_error_levels: float) -> Measured:
    """The cheapest way to draw that was measured to stay within an image error; ValueError if none does."""
    for measured in MEASURED:
        if measured.error_levels <= max_error_levels:
            return measured
    raise ValueError(
        f"image error {max_error_levels} grey levels; expected {MEASURED[-1].error_levels} or more, "
        "the least of all ways to draw that were measured"
    )

"""How faithfully a scene is drawn, and what that costs."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Fidelity:
    """`supersample`: the image is drawn that many times as wide and high, and averaged.  `multisample`:
    edges (only) take four samples a drawn pixel.  `fineness`: a ball has 20·4^fineness triangles, a tube
    4·fineness sides, and nothing an edge longer than 0.4/2^fineness m (×4 in the room), where the lens's
    bending is exact.  `lights`: lamps, 0–3; none: all is equally lit.  `shadows`: the first lamp casts them.
    `blur_step_px`: a blurred image is the mean of images at most this far apart.
    """

    supersample: int = 1
    multisample: bool = True
    fineness: int = 3
    lights: int = 1
    shadows: bool = False
    blur_step_px: float = 1.5

    def __post_init__(self) -> None:
        if not (1 <= self.supersample <= 8 and 0 <= self.fineness <= 6 and 0 <= self.lights <= 3):
            raise ValueError(f"{self}; expected supersample 1–8, fineness 0–6, lights 0–3")
        if not self.blur_step_px > 0:
            raise ValueError(f"{self}; expected a positive step of the blur")
        if self.shadows and not self.lights:
            raise ValueError(f"{self}; expected a light where there are shadows")

    @property
    def edge_m(self) -> float:
        """Longest edge of anything that moves; the room's are four times as long."""
        return 0.4 / 2**self.fineness

    @property
    def pixel_spread(self) -> float:
        """Over what part of a pixel the samples of successive images should be spread to smooth edges."""
        return 0.0 if self.multisample else 1 / self.supersample

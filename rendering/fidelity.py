"""How faithfully a scene is drawn, and what that costs."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Fidelity:
    """`supersample`: the image is drawn that many times as wide and high, and averaged.  `multisample`:
    edges (only) take four samples a drawn pixel.  `fineness`: a ball has 20·4^fineness triangles, a tube
    4·(fineness − 1) sides, and nothing an edge longer than 0.2/2^fineness m (×4 on the walls): the lens's bending
    is exact at corners.  `lights`: lamps, 0–3; none: all is equally lit.  `shadows`: the first lamp casts them.
    `blur_step_px`: what moves so far while the shutter is open costs a further image to average (what moves
    less than 0.4 of it is drawn sharp).
    """

    supersample: int = 1
    multisample: bool = True
    fineness: int = 3
    lights: int = 3
    shadows: bool = False
    blur_step_px: float = 2.5

    def __post_init__(self) -> None:
        if not (1 <= self.supersample <= 8 and 0 <= self.fineness <= 6 and 0 <= self.lights <= 3):
            raise ValueError(f"{self}; expected supersample 1–8, fineness 0–6, lights 0–3")
        if not self.blur_step_px > 0:
            raise ValueError(f"{self}; expected a positive step of the blur")
        if self.shadows and not self.lights:
            raise ValueError(f"{self}; expected a light where there are shadows")

    @property
    def edge_m(self) -> float:
        """Longest edge of anything that moves and of the table; the walls' are four times as long."""
        return 0.2 / 2**self.fineness

    @property
    def pixel_spread(self) -> float:
        """Over what part of a pixel the samples of successive images should be spread to smooth edges."""
        return 0.0 if self.multisample else 1 / self.supersample


@dataclass(frozen=True)
class Measured:
    """What a way to draw costs, relative to the default's time, and how far its image of a ball or a marker
    (the worse) is from the finest one's: RMS grey levels of 255 over the object and two pixels around it."""

    fidelity: Fidelity
    cost: float
    error_levels: float

    def __str__(self) -> str:
        f = self.fidelity
        samples = f.supersample**2 * (4 if f.multisample else 1)
        return (
            f"{samples} samples a pixel, fineness {f.fineness}, {f.lights} lamps, "
            f"{'with' if f.shadows else 'no'} shadows: {self.error_levels} grey levels from the finest, "
            f"at {self.cost} of the default's time"
        )


# `pps-vision bench fidelity` measures it (seed 0): balls and markers, 0.25–0.6 m before the eyes.  Lamps cost nothing,
# and the object's image gains nothing from shadows or from more triangles before it has more samples.
MEASURED = (
    Measured(Fidelity(multisample=False, fineness=1), 0.4, 12.0),
    Measured(Fidelity(fineness=2), 0.75, 4.3),
    Measured(Fidelity(), 1.0, 4.1),
    Measured(Fidelity(supersample=2, multisample=False), 1.1, 3.6),
    Measured(Fidelity(supersample=2), 2.2, 1.7),
    Measured(Fidelity(supersample=4, fineness=4), 8.0, 0.7),
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

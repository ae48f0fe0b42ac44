"""What the skin is taught with."""

from dataclasses import dataclass

from rendering.names import StimulusName


@dataclass(frozen=True)
class SchoolParams:
    """What the skin is taught with, and how noisy the eyes are."""

    trials: int = 24
    """Approaches that end in a touch."""
    noise_sigma: float = 2.0
    """Pixel noise, grey levels of 255."""
    objects: tuple[StimulusName, ...] = ("ball", "cube")
    """What touches, in turn."""

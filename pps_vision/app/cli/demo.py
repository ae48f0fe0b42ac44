"""`pps-vision demo`: learn which approaches touch, then avoid an unknown object."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Demo:
    """Close the loop: learn the arm's skin from rendered approaches, then avoid an octopus.

    With avoidance off, with avoidance on, receding, and standing still; and before an iCub whose body is 3 cm off, with
    nothing learned and after 20 touches; everything in report.html. With --encounters objects come at both arms, fast
    and slow; the report shows the best, the median and every one that touched.
    """

    out: Path = Path("demo")
    """Folder for report.html, demo.mp4, demo.png, memory.npz, reach.npz and summary.json."""
    trials: int = 36
    """Approaches of ball and cube to learn from; one in three touches, the others stop before the skin."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    seed: int = 0
    """Seed of the random numbers."""
    robot: Path | None = None
    """robot.toml of another robot, whose arm learns and avoids; default: the iCub."""
    encounters: int | None = None
    """Run this number of encounters instead, without and with avoidance."""

    def run(self) -> None:
        from pps_vision.app.demo import demo, demo_encounters

        if self.encounters is not None:
            return demo_encounters(self.out, self.encounters, self.noise, self.seed, robot=self.robot)
        demo(self.out, self.trials, self.noise, self.seed, self.robot)

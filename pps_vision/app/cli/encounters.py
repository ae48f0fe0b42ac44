"""`pps-vision encounters`: compare controllers of the arm on the same simulated encounters (PPS-Bench)."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Encounters:
    """Let controllers of the arm meet the same simulated objects, without rendering, and compare them (PPS-Bench).

    Objects press on, fly through, stop or graze; harmless ones recede, rest or pass.  Each controller meets them on
    exact tracks, as tracked, and with more noise.  `bench encounters` and `demo --encounters` draw from the same kinds.
    """

    controller: tuple[str, ...] = ()
    """Controllers to compare with the shipped ones, MODULE:FUNCTION (docs/howto/controller.md)."""
    out: Path = Path("encounters")
    """Folder for report.html and encounters.json, a row of each encounter."""
    n: int = 300
    """Encounters of each controller and kind of track."""
    seed: int = 0
    """Seed of the encounters and of the approaches that the skin learns from."""
    share: float = 1.0
    """Share of R's numbers of training approaches (77 to the palm, …); a small one for a trial run."""
    workers: int = 2
    """Parallel processes."""

    def run(self) -> None:
        from pps_vision.app.encounters.benchmark import SHIPPED, benchmark
        from pps_vision.errors import InputError
        from pps_vision.recordings import REPORT

        if min(self.n, self.workers) < 1 or not 0 < self.share <= 1:
            given = f"--n {self.n}, --workers {self.workers}, --share {self.share}"
            raise InputError("encounters", f"{given}; expected at least 1, and a share of at most 1")
        names = (*SHIPPED, *self.controller)
        for perception, rates in benchmark(self.out, self.n, self.seed, names, self.workers, self.share).items():
            ranked = sorted(rates, key=lambda name: -rates[name].score[0])
            print(f"{perception}: {', '.join(f'{name} {rates[name].score[0]:.1f} %' for name in ranked)}")
        print("→", self.out / REPORT)

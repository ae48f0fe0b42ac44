"""`pps-vision render`: render the recording of an iCub that watches a moving object, with its truth."""

from dataclasses import dataclass

from pps_vision.app.render_params import RenderParams


@dataclass(frozen=True)
class Render(RenderParams):
    """Write a recording in yarpdatadumper layout, with calibration, touches, truth.csv and settings (summary.json)."""

    def run(self) -> None:
        from pps_vision.app.render import record

        pairs, touches = record(self)
        print(f"{pairs} pairs, skin touched in {touches} → {self.out}")

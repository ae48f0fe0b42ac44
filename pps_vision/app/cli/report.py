"""`pps-vision report`: an HTML page for the results of `track` or `batch`."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional


@dataclass(frozen=True)
class Report:
    """Write report.html into a folder of `track`, or into a folder of `batch` and of all its recordings.

    The pages are self-contained.
    """

    folder: Positional[Path]
    """Folder that `track` or `batch` has written."""

    def run(self) -> None:
        from pps_vision.app.report.tracking import report_folder
        from pps_vision.recordings import REPORT

        print(report_folder(self.folder), "→", self.folder / REPORT)

"""`pps-vision info`: contents and defects of a recording, and the command that tracks it."""

from dataclasses import asdict, dataclass, fields

from pps_vision.app.cli.options import RecordingSource, command_line, print_skipped


@dataclass(frozen=True)
class Info(RecordingSource):
    """Print a recording's rates, gaps, desynchronisation and cameras, with missing or implausible items.

    The options are as for `track`; the last line is the command that tracks this recording.
    """

    json: bool = False
    """Print JSON instead."""

    def run(self) -> None:
        from pps_vision.app.info import info
        from pps_vision.app.versions import versions
        from pps_vision.recordings.atomic_write import json_text

        recording = self.open()
        findings = info(recording)
        tracking = command_line("track", self, fields(RecordingSource))
        command = tracking + " --calib FILE" * (recording.rig is None) + " --out path"
        if self.json:
            print(json_text(asdict(findings) | {"command": command, "versions": versions()}))
            return
        print_skipped(recording.problems)
        print(findings)
        print(command)

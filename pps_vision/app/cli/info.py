"""`pps-vision info`: what a recording holds and lacks, and the command that tracks it."""

from dataclasses import asdict, dataclass, fields

from pps_vision.app.cli.options import SourceOptions, command_line, print_skipped


@dataclass(frozen=True)
class Info(SourceOptions):
    """Print what a recording holds: rates, gaps, desynchronisation, cameras, and what is missing or implausible.

    The options are those of `track`; the last line is the command that tracks this recording.
    """

    json: bool = False
    """Print JSON instead."""

    def run(self) -> None:
        """Read the recording, but for a few images only its stamps."""
        import json

        from pps_vision.app.info import info
        from pps_vision.app.versions import versions
        from pps_vision.recordings.outputs import plain

        recording = self.open()
        found = info(recording)
        command = self.command(with_calib=recording.rig is None)
        if self.json:
            numbers = asdict(found) | {"command": command, "versions": versions()}
            print(json.dumps(plain(numbers), indent=2, ensure_ascii=False))
            return
        print_skipped(recording.problems)
        print(found)
        print(command)

    def command(self, with_calib: bool) -> str:
        """The command that tracks this recording; with a place for the calibration that it lacks."""
        return command_line("track", self, fields(SourceOptions)) + " --calib FILE" * with_calib + " --out path"

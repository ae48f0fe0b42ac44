"""`pps-vision clock`: delay and drift between the cameras of a recording, and of its joints."""

from dataclasses import dataclass

from pps_vision.app.cli.options import RecordingSource, print_skipped


@dataclass(frozen=True)
class Clock(RecordingSource):
    """Estimate the delay and the drift of the right camera's stamps, and of the joints, from the images.

    Of cameras that rest from the largest moving object, of a robot from the turns of its cameras.  Each delay has a
    95 % interval, or the reason why it is unobservable.  `track --clock auto` corrects them.
    """

    json: bool = False
    """Print JSON instead."""

    def run(self) -> None:
        from pps_vision.app.clock import clocks
        from pps_vision.app.versions import versions
        from pps_vision.recordings.atomic_write import json_text

        recording = self.open()
        found = clocks(recording)
        if self.json:
            print(json_text({**found.numbers(), "versions": versions()}))
            return
        print_skipped(recording.problems)
        print(found)

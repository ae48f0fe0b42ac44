"""Stereo vision for robots that predict touch.

    import pps_vision as pv

    recording = pv.render("ball", "circle", "rec", seconds=2.0)   # or pv.open_recording("rec")
    for step in pv.track(recording):
        print(step.track.stamp_s, step.track.position, step.track.status)

Names are imported when they are first used: `import pps_vision` takes no time.  docs/examples shows them.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from learning.reach.map import ReachableMap as ReachableMap
    from pps_vision.app.learn import learn as learn
    from pps_vision.app.pipeline import Pipeline as Pipeline
    from pps_vision.app.render import render as render
    from pps_vision.app.track import track as track
    from pps_vision.app.triangulate import triangulate as triangulate
    from pps_vision.errors import InputError as InputError
    from pps_vision.recordings.open import open_recording as open_recording
    from tracking.tracker import Tracker as Tracker

    __version__: str

_MODULES = {
    "InputError": "pps_vision.errors",
    "Pipeline": "pps_vision.app.pipeline",
    "ReachableMap": "learning.reach.map",
    "Tracker": "tracking.tracker",
    "learn": "pps_vision.app.learn",
    "open_recording": "pps_vision.recordings.open",
    "render": "pps_vision.app.render",
    "track": "pps_vision.app.track",
    "triangulate": "pps_vision.app.triangulate",
}
__all__ = sorted([*_MODULES, "__version__"])


if not TYPE_CHECKING:  # a type checker would take any name to exist

    def __getattr__(name: str) -> object:
        """Import a public name at its first use (PEP 562)."""
        if name == "__version__":
            from importlib.metadata import version

            value: object = version("pps-vision")
        elif name in _MODULES:
            value = getattr(import_module(_MODULES[name]), name)
        else:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return __all__

"""What an experiment is, and where real data are looked for."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, runtime_checkable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DATA = Path(os.environ.get("PPS_VISION_DATA", "../shared/data"))
"""Folder of the real data (default of every `--data`)."""

SceneSource = Literal["rendered", "independent"]
Scenes = Literal["rendered", "independent", "both"]


@runtime_checkable
class Experiment(Protocol):
    """A frozen dataclass of parameters that measures."""

    def run(self) -> dict[str, Any]:
        """The numbers, as they will stand in docs/results."""
        ...


@runtime_checkable
class Charted(Protocol):
    """An experiment that draws the numbers it measured."""

    def chart(self, numbers: dict[str, Any]) -> "Figure | dict[str, Figure]":
        """The chart of what `run` returned, or several by their names."""
        ...


@runtime_checkable
class Series(Protocol):
    """Several experiments that belong together."""

    def parts(self) -> dict[str, Experiment]:
        """The experiments by name, each made alone."""
        ...

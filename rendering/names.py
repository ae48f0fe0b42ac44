"""The names that a user chooses from; importing them loads nothing else."""

from typing import Literal

StimulusName = Literal["marker", "ball", "cube", "octopus"]
MotionName = Literal["approach", "recede", "static", "circle", "figure8", "linear", "jerk"]
CarrierName = Literal["none", "stick", "hand"]
Unit = Literal["m", "cm", "mm"]

MESH_SUFFIXES = (".stl", ".obj", ".ply")

"""Names of stimuli, motions and carriers; imports nothing heavy."""

from typing import Literal

StimulusName = Literal["marker", "ball", "cube", "octopus"]
MotionName = Literal["approach", "recede", "static", "circle", "figure8", "linear", "jerk"]
CarrierName = Literal["none", "stick", "hand"]
Unit = Literal["m", "cm", "mm"]

MESH_SUFFIXES = (".stl", ".obj", ".ply")

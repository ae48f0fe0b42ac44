"""Stereo vision for robots that feel what is about to touch them."""

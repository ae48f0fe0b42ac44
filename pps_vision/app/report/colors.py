"""Colours of tracks in images, pages and views."""

_RGB = ((42, 157, 74), (40, 110, 220), (235, 140, 20), (200, 70, 170), (20, 170, 190), (140, 90, 50))


def track_rgb(track_id: int) -> tuple[int, int, int]:
    """The colour of a track by its number; the first one's is green."""
    return _RGB[(track_id - 1) % len(_RGB)]


def track_hex(track_id: int) -> str:
    """The same as #rrggbb."""
    return "#{:02x}{:02x}{:02x}".format(*track_rgb(track_id))

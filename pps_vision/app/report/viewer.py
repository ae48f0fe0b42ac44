"""The view of a tracked recording for the Rerun viewer, an .rrd file written as tracking goes on.

| entity | holds, on the timeline `stamp` |
|---|---|
| left, right | the images (JPEG) |
| left/detection, right/detection | centres of the objects in the image, px; the attended one's larger |
| track | the 95 % ellipsoids of their positions, root frame, m; the attended one's first and labelled |
| path, truth | the whole paths, at all times |
| distance, time_to_contact | m and s, as in the report, of the attended object |
"""

from collections import defaultdict
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from scipy.spatial.transform import Rotation

from pps_vision.app.report.colors import track_rgb
from pps_vision.app.report.path3d import distance_and_ttc_of_origin, ellipsoid_95
from pps_vision.errors import InputError
from pps_vision.types import Array, StereoFrame, Truth
from tracking.tracker import TrackerStep

VIEW = "view.rrd"
_JPEG_QUALITY = 75  # OpenCV's is 95, at three times the size
_GREY = (119, 119, 119)


class ViewFile(AbstractContextManager["ViewFile"]):
    """An .rrd file, written as frames come.  Nothing is sent anywhere, and no viewer is started."""

    def __init__(self, path: Path) -> None:
        """InputError without the extra `viewer`."""
        try:
            import rerun
        except ImportError as error:
            raise InputError(path.name, "needs the extra viewer: pip install 'pps-vision[viewer]'") from error
        self._rr, self._recording = rerun, rerun.RecordingStream("pps_vision")
        self._recording.save(path)
        self._paths: defaultdict[int, list[list[Array]]] = defaultdict(list)  # parts of each track's path
        self._known: set[int] = set()  # tracks known in the last pair

    def add(self, frame: StereoFrame, step: TrackerStep) -> None:
        """Append a stereo pair and its tracking result."""
        rr = self._rr
        log = self._recording.log
        tracks = [track for track in step.tracks if track.is_known]
        objects = step, *(other for other in step.others if other.track.is_known)
        self._recording.set_time("stamp", duration=frame.stamp_s)
        for camera, image in (("left", frame.left), ("right", frame.right)):
            log(camera, rr.Image(image).compress(_JPEG_QUALITY))
            rows = [(item, found.center_px) for item in objects for found in item.detections if found.camera == camera]
            points = rr.Points2D(
                [center_px for _, center_px in rows],
                colors=[track_rgb(item.track.track_id) for item, _ in rows],
                radii=[4 if item is step else 3 for item, _ in rows],
            )
            log(f"{camera}/detection", points)
        for track in tracks:
            if track.track_id not in self._known:
                self._paths[track.track_id].append([])
            self._paths[track.track_id][-1].append(track.position)
        self._known = {track.track_id for track in tracks}
        if not tracks:
            log("track", rr.Clear(recursive=False))
            return
        shapes = [ellipsoid_95(track.cov[:3, :3]) for track in tracks]
        ellipsoids = rr.Ellipsoids3D(
            centers=[track.position for track in tracks],
            half_sizes=[lengths for lengths, _ in shapes],
            quaternions=[Rotation.from_matrix(rotation).as_quat() for _, rotation in shapes],
            colors=[track_rgb(track.track_id) for track in tracks],
            labels=[f"{track.track_id}{' (attended)' * (track is tracks[0])}" for track in tracks],
        )
        log("track", ellipsoids)
        distance, ttc = distance_and_ttc_of_origin(step.track.position, step.track.velocity)
        log("distance", rr.Scalars(float(distance)))
        log("time_to_contact", rr.Scalars(float(ttc)))

    def finish(self, truth: Sequence[Truth]) -> None:
        """Append the whole path, and the true one where it is known."""
        strips = [(track_rgb(track_id), strip) for track_id, parts in self._paths.items() for strip in parts]
        true = [(_GREY, [row.position for row in truth])] if truth else []
        for name, lines in (("path", strips), ("truth", true)):
            colors = [color for color, _ in lines]
            self._recording.log(name, self._rr.LineStrips3D([line for _, line in lines], colors=colors), static=True)

    def __exit__(self, *error: object) -> None:
        self._recording.disconnect()

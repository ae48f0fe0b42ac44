"""The view of a tracked recording for the Rerun viewer, an .rrd file written as tracking goes on.

| entity | holds, on the timeline `stamp` |
|---|---|
| left, right | the images (JPEG) |
| left/detection, right/detection | centre of the object in the image, px |
| track | the 95 % ellipsoid of its position, root frame, m |
| path, truth | the whole paths, at all times |
| distance, time_to_contact | m and s, as in the report |
"""

from collections.abc import Sequence
from pathlib import Path

from scipy.spatial.transform import Rotation

from pps_vision.app.report.path3d import distance_and_ttc_of_origin, ellipsoid_95
from pps_vision.errors import InputError
from pps_vision.types import Array, StereoFrame, Truth
from tracking.tracker import TrackerStep

VIEW = "view.rrd"
_JPEG_QUALITY = 75  # OpenCV's is 95, at three times the size
_GREEN, _GREY = (42, 157, 74), (119, 119, 119)


class ViewFile:
    """An .rrd file, written as frames come.  Nothing is sent anywhere, and no viewer is started."""

    def __init__(self, path: Path) -> None:
        """InputError without the extra `viewer`."""
        try:
            import rerun
        except ImportError as error:
            raise InputError(path.name, "needs the extra viewer: pip install 'pps-vision[viewer]'") from error
        self._rr, self._recording = rerun, rerun.RecordingStream("pps_vision")
        self._recording.save(path)
        self._path: list[list[Array]] = [[]]

    def __enter__(self) -> "ViewFile":
        return self

    def add(self, frame: StereoFrame, step: TrackerStep) -> None:
        """Append a stereo pair and its tracking result."""
        rr = self._rr
        log = self._recording.log
        track = step.track
        self._recording.set_time("stamp", duration=frame.stamp_s)
        for camera, image in (("left", frame.left), ("right", frame.right)):
            log(camera, rr.Image(image).compress(_JPEG_QUALITY))
            centers_px = [detection.center_px for detection in step.detections if detection.camera == camera]
            log(f"{camera}/detection", rr.Points2D(centers_px, colors=_GREEN, radii=3))
        if not track.is_known:
            log("track", rr.Clear(recursive=False))
            self._path.append([])
            return
        self._path[-1].append(track.position)
        lengths, rotation = ellipsoid_95(track.cov[:3, :3])
        turn = Rotation.from_matrix(rotation).as_quat()
        ellipsoid = rr.Ellipsoids3D(centers=[track.position], half_sizes=[lengths], quaternions=[turn], colors=_GREEN)
        log("track", ellipsoid)
        distance, ttc = distance_and_ttc_of_origin(track.position, track.velocity)
        log("distance", rr.Scalars(float(distance)))
        log("time_to_contact", rr.Scalars(float(ttc)))

    def finish(self, truth: Sequence[Truth]) -> None:
        """Append the whole path, and the true one where it is known."""
        paths = {"path": (self._path, _GREEN), "truth": ([[row.position for row in truth]], _GREY)}
        for name, (strips, color) in paths.items():
            self._recording.log(name, self._rr.LineStrips3D([s for s in strips if s], colors=color), static=True)

    def __exit__(self, *error: object) -> None:
        self._recording.disconnect()

"""Reachability of the tracked object: track → gaze that fixates it → reachable-space map (J, "Reachable space map")."""

from learning.reach.map import ReachableMap
from pps_vision.robot.gaze import GazeModel
from pps_vision.robot.model import Robot
from pps_vision.types import Array, Mask, Reachability, ReachStatus, Track3D


class TrackReachability:
    """Queries a robot's reachable-space map for the tracked object, frame by frame."""

    def __init__(self, robot: Robot, reachable_map: ReachableMap, max_false_positives: float = 1e-3) -> None:
        """At most the share `max_false_positives` of the unreachable postures is called reachable, by the map's own
        probabilities: a false positive dooms a reach, a false negative only moves the body (J)."""
        self.map = reachable_map
        self.threshold = reachable_map.threshold(max_false_positives)
        self.gaze_model = GazeModel(robot)

    def __call__(self, q_rad: Array, track: Track3D) -> Reachability:
        """Reachability of a track in the root frame, with the robot at configuration `q_rad` (n_joints,).

        The torso carries both eyes and arms, so only the object's position relative to it counts, not the posture of
        head and arms.
        """
        if not track.is_known:
            return Reachability.without_answer(track.stamp_s, ReachStatus.UNKNOWN)
        point = self.gaze_model.to_upright(q_rad[None], track.position)
        gaze = self.gaze_model.gaze(point, self.map.limits)
        predicted = self.map.query(gaze, self.threshold)
        if not predicted.within_limits[0]:
            return Reachability.without_answer(track.stamp_s, ReachStatus.NOT_FIXATED)
        status = ReachStatus.REACHABLE if predicted.reachable[0] else ReachStatus.UNREACHABLE
        return Reachability(track.stamp_s, gaze[0], float(predicted.probability[0]), float(predicted.degree[0]), status)

    def reachable(self, gaze: Array) -> Mask:
        """The map's verdict (N,) on gaze postures (N, 3); False for NaN."""
        return self.map.query(gaze, self.threshold).reachable

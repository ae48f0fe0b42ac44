"""The parameters of every study: what `pps-vision bench NAME --help` shows.

They stand apart from the studies so that showing them loads no more than this file; a study is the class of the same
name in its own file, derived from its parameters.
"""

from dataclasses import dataclass
from pathlib import Path

from pps_vision.app.school_params import SchoolParams
from pps_vision.experiments.experiment import DATA, Scenes


@dataclass(frozen=True)
class Loop:
    """Encounters with an octopus at 5–15 cm/s after learning from ball and cube: who is touched, who moves
    without cause.

    Cases: approach with avoidance on and off, receding, standing still, own arm moving with nothing near.
    """

    n: int = 20
    """Encounters of every case."""
    seed: int = 0
    """Seed of the school and the encounters."""
    school: SchoolParams = SchoolParams()


@dataclass(frozen=True)
class Tracking:
    """Rendered balls (generic tracker) and markers (marker tracker) at 5–15 cm/s while the head moves."""

    n: int = 10
    """Recordings of each, their motions in turn."""
    seconds: float = 5.0
    """Length of each."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    seed: int = 0
    """Seed of the first; the others count up."""
    scenes: Scenes = "both"
    """Rendered scenes, independent ones, or both."""


@dataclass(frozen=True)
class Fixation:
    """Fixation at 20 Hz: how soon a static point is within 0.5°, how far 15 cm/s at 0.4 m gets away.

    The controller is told where the point truly was one frame ago: this measures control, not sight.
    """

    n: int = 100
    """Points of each kind."""
    seed: int = 0
    """Seed of the points."""


@dataclass(frozen=True)
class Real:
    """Real data: a ball in one view, a thrown ball in stereo, a robot's touches, a robot's recording.

    What is absent is skipped, saying so.
    """

    data: Path = DATA
    """Folder that holds vot_ball1, baseball, pps_real_robot, yarp_dump (PPS_VISION_DATA, else ../shared/data)."""
    seed: int = 0
    """Seed of the particles."""


@dataclass(frozen=True)
class Trigger:
    """Head still or turning at up to 20°/s, the arms in view, and turning before photographs, with late joints and
    changing light: time per image, false alarms, images until a ball or marker that starts to move is found; flow
    error on RubberWhale; the velocity with which the tracker begins, with and without flow.  Ours has one setting;
    each peer gets, for either setting, its best level: the lowest without a false alarm in another scene."""

    n: int = 2
    """Scenes of each kind, each in both eyes."""
    seconds: float = 10.0
    """How long nothing moves, in each of `n` scenes of the last setting and in one of the others."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    seed: int = 0
    """Seed of places, motions and noise."""
    peers: bool = True
    """With --no-peers only ours, for long runs."""
    films: int = 20
    """Films of either source on which the tracker's first velocity is measured."""
    data: Path = DATA
    """Folder that holds rubberwhale and the photographs (default: PPS_VISION_DATA, else ../shared/data)."""


@dataclass(frozen=True)
class Fidelity:
    """Rendered balls and markers, drawn in many ways, beside ray-cast images: image error and tracking error."""

    n: int = 4
    """Scenes of each object whose images are compared."""
    seconds: float = 3.0
    """Length of the recording of each object that is tracked, 20 pairs a second, pixel noise 2 of 255."""
    seed: int = 0
    """Seed of the first scene; the others count up."""


@dataclass(frozen=True)
class ImageTracker:
    """Blob, particles and OpenCV's trackers in one eye, the first box given: time, overlap and centre error.

    Rendered balls and markers, slow and watched (5–15 cm/s, eyes that follow while the head sways) and fast
    (60 cm/s, eyes that do not follow: up to twice the object's size a frame); and the real ball vot_ball1.
    """

    n: int = 6
    """Rendered recordings, slow and fast each; balls and markers in turn."""
    seconds: float = 2.5
    """Length of each."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    data: Path = DATA
    """Folder that holds vot_ball1 (default: PPS_VISION_DATA, else ../shared/data)."""
    seed: int = 0
    """Seed of the motions, the noise and the particles."""


@dataclass(frozen=True)
class Batches:
    """A rendered marker and a rendered ball followed frame by frame and by `track --device`: pairs per second against
    the size of the batch, with one and two threads and on a CUDA device where there is one, and how far the
    detections are apart."""

    n: int = 52
    """Stereo pairs of a recording."""
    recordings: int = 4
    """Recordings of each object."""
    repeats: int = 2
    """Runs over the recordings of every way, in turn."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    seed: int = 0
    """Seed of the first recording; each further one has the next."""


@dataclass(frozen=True)
class Pipeline:
    """Balls and markers that approach the skin at 5–30 cm/s while the head moves, through our pipelines and the
    peers', which are told the true boxes in the first frame and get our filter.

    Time a stereo pair, 3D error, and error of the time to contact in the last half second.
    """

    n: int = 4
    """Approaches of a ball, and as many of a marker, their speeds spread over the range."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    seed: int = 0
    """Seed of the approaches, the noise and the particles."""
    scenes: Scenes = "both"
    """Rendered scenes, independent ones, or both."""


@dataclass(frozen=True)
class Failures:
    """A red ball before a robot that looks at it, and everything that can go wrong, each alone and from mild to
    hopeless.  Ours has to find the ball; the peers are given its true boxes in the first frame."""

    n: int = 1
    """Recordings of every severity."""
    seed: int = 0
    """Seed of the first; the others count up."""
    csrt: bool = True
    """Whether CSRT is put on them too, on the first recordings only: it takes more time than all the rest."""
    scenes: Scenes = "both"
    """Rendered scenes, independent ones (which do not show the robot's arms), or both."""


@dataclass(frozen=True)
class Budget:
    """The cheapest configuration that meets an asked-for error: is it met, at what cost, scene by scene."""

    n: int = 2
    """Recordings of each scene for the table, and as many others for the test."""
    seconds: float = 4.0
    """Length of each."""
    seed: int = 0
    """Seed of the recordings the table is measured on; those it is tested on are others."""


@dataclass(frozen=True)
class Triangulation:
    """Error of one point's triangulation, as a multiple of the Cramér–Rao bound, over depth and vergence.

    The eyes see alike (0.1 px), or differ: the left one has 0.5 px along a diagonal (an outline half hidden, a
    blur) and 0.05 px across it.
    """

    n: int = 150
    """Points for each depth, vergence and kind of noise."""
    seed: int = 0
    """Seed of the points and the noise."""


@dataclass(frozen=True)
class Stereo:
    """3D error and time of centroid triangulation and of disparity in the region or the whole image, over
    distance and vergence, textured and not; of the tracker's observations before its filter; and of disparity
    on `motorcycle`."""

    n: int = 20
    """Scenes for each distance and vergence; a tenth of the windows on `motorcycle`."""
    frames: int = 60
    """Length of each tracked recording."""
    depths_m: tuple[float, ...] = (0.2, 0.3, 0.4, 0.6, 0.8, 1.2, 2.0)
    """Distances, 0.4 m among them; a marker is tracked at those up to 0.8 m."""
    vergences_deg: tuple[float, ...] = (0.0, 10.0, 20.0, 30.0, 40.0)
    """Vergences at 0.3 m; 0 is parallel."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    data: Path = DATA
    """Folder that holds `motorcycle` (default: PPS_VISION_DATA, else ../shared/data)."""
    seed: int = 0
    """Seed of scenes and noise."""


@dataclass(frozen=True)
class Soak:
    """A rendered lap of 4 s again and again while the head sways: a ball (generic), a marker, and nothing (idle:
    the trigger only).  Memory, time and covariance at the start and at the end."""

    frames: int = 10_000
    """Stereo pairs of each."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    seed: int = 0
    """Seed of the noise and the particles."""


@dataclass(frozen=True)
class Filter:
    """Filters of orders 1–4, of automatic order, with constant gain, with and without RTS smoothing, and peers.

    On the measurements of rendered balls and markers (noisy images, head moving), and on tt3d's noisy flights,
    where that folder is.  filterpy is skipped where it is not installed.
    """

    n: int = 1
    """Recordings of each object on each motion, and of each at each speed of approach."""
    seconds: float = 5.0
    """Length of the recordings that are no approaches."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    data: Path = DATA
    """Folder that holds tt3d (default: PPS_VISION_DATA, else ../shared/data)."""
    seed: int = 0
    """Seed of the first recordings; the others count up."""


@dataclass(frozen=True)
class Consistency:
    """Rendered balls and markers (noisy images, head moving): errors against the covariances that come with them.

    Judged from the tenth measurement on; where the velocity jumps at once, which nothing in a hand does, not in
    that frame and the next (`with_jumps` counts them too).
    """

    n: int = 4
    """Recordings of each object on each motion, and of each at each speed of approach."""
    seconds: float = 5.0
    """Length of the recordings that are no approaches."""
    noise: float = 2.0
    """Pixel noise, grey levels of 255."""
    seed: int = 0
    """Seed of the first recordings; the others count up."""
    scenes: Scenes = "both"
    """Rendered scenes, independent ones, or both."""


@dataclass(frozen=True)
class Independent:
    """Every case of the tracking table on scenes that share no code with our renderer.

    Right: status tracking, less than 30 mm off, as a share of the frames from 1 s on (of `start` rest: from 1 s after
    the object first moves) in which both eyes see at least half of the object.  False claim: status tracking, more
    than 50 mm off, as a share of all frames.  Error (median) and coverage of the 95 %
    ellipsoid: over the frames of the first share with status tracking.
    """

    n: int = 2
    """Films of each case, over different photographs."""
    seed: int = 0
    """Seed of the first film of a case; the others count up."""
    data: Path = DATA
    """Folder of the photographs (default: PPS_VISION_DATA, else ../shared/data); procedural where they are absent."""
    only: str = ""
    """Only the cases whose names contain this."""

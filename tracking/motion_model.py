"""Motion model of the 3D filter: the Kalman filter's own (`kalman`), or the flight of a thrown ball (`flight`).

Both have beliefs of one form, and `kalman.gate` and `kalman.update` take measurements in with `measured_with`.
"""

from pps_vision.types import Array
from tracking import flight, kalman
from tracking.flight import FlightParams
from tracking.kalman import Belief, KalmanParams

MotionModel = KalmanParams | FlightParams


def scaled(model: MotionModel, distance_m: float) -> MotionModel:
    """The model for an object at a distance (`kalman.scaled`); a flight's, which has gravity, is the same at all."""
    return model if isinstance(model, FlightParams) else kalman.scaled(model, distance_m)


def measured_with(model: MotionModel) -> KalmanParams:
    """The parameters with which measurements are gated and taken in."""
    return model.filter if isinstance(model, FlightParams) else model


def prior_std(model: MotionModel) -> tuple[float, float]:
    """Standard deviation of velocity (m/s) and acceleration (m/s²) before anything was measured."""
    if isinstance(model, FlightParams):
        return model.speed_std, flight.GRAVITY_M_S2
    return model.prior_std[:2]


def start(
    model: MotionModel,
    stamp_s: float,
    position: Array,
    cov: Array,
    velocity: Array | None = None,
    velocity_cov: Array | None = None,
    correlated: Array | None = None,
) -> Belief:
    """The belief after the first measurement; the arguments are those of `kalman.start`."""
    measured = stamp_s, position, cov, velocity, velocity_cov, correlated
    return flight.start(model, *measured) if isinstance(model, FlightParams) else kalman.start(model, *measured)


def forecast(model: MotionModel, belief: Belief, stamp_s: float) -> tuple[Belief, Array]:
    """The belief at a later stamp, and the covariance of the state now with the state then."""
    if isinstance(model, FlightParams):
        return flight.forecast(model, belief, stamp_s)
    return kalman.forecast(model, belief, stamp_s)


def predict(model: MotionModel, belief: Belief, stamp_s: float) -> Belief:
    """The belief at a later stamp; ValueError for an earlier one."""
    return forecast(model, belief, stamp_s)[0]


def derivatives(model: MotionModel, belief: Belief) -> tuple[Array, Array]:
    """Position and its derivatives (n, 3) that the belief knows, and their covariance (3n, 3n)."""
    if isinstance(model, FlightParams):
        return flight.derivatives(model, belief)
    return belief.mean, belief.cov

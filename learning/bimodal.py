"""A neuron that both sees and feels: R's discussion proposes the sum of spatial and tactile input."""

import numpy as np
from numpy.typing import ArrayLike

from pps_vision.types import Array


def bimodal_activation(spatial: ArrayLike, tactile: ArrayLike) -> Array:
    """(…, n) the sum of the spatial `activation` and of what each taxel feels, both in [0, 1], at most 1.

    `tactile` is the pressure as a share of the skin's full scale, or whether it is touched at all.
    """
    seen, felt = np.asarray(spatial, dtype=float), np.asarray(tactile, dtype=float)
    for name, value in (("spatial", seen), ("tactile", felt)):
        if not np.all((value >= 0) & (value <= 1)):
            raise ValueError(f"{name} input {value.min():g} … {value.max():g}: expected shares between 0 and 1")
    total: Array = np.minimum(seen + felt, 1.0)
    return total

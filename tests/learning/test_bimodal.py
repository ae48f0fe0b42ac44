"""The sum of what is seen and what is felt."""

import numpy as np
import pytest

from learning.bimodal import bimodal_activation


def test_seen_and_felt_add_up_to_at_most_one():
    np.testing.assert_allclose(bimodal_activation([0.0, 0.3, 0.3, 0.9], [0.0, 0.0, 0.5, 0.5]), [0, 0.3, 0.8, 1])
    np.testing.assert_array_equal(bimodal_activation([0.2, 0.2], [True, False]), [1.0, 0.2])


@pytest.mark.parametrize("bad", [-0.1, 1.5, np.nan])
def test_what_is_no_share_is_refused(bad):
    with pytest.raises(ValueError, match=r"spatial input .*: expected shares between 0 and 1"):
        bimodal_activation([bad], [0.0])
    with pytest.raises(ValueError, match="tactile input"):
        bimodal_activation([0.0], [bad])

"""Archives of arrays: exact copies are read, anything else is refused."""

from importlib.metadata import version

import numpy as np
import pytest

from learning.archive import read_archive, write_archive
from pps_vision.errors import InputError


def test_what_is_written_is_read_and_nothing_else_is_left(tmp_path):
    file = tmp_path / "a.npz"
    write_archive(file, "map", 2, {"x": np.arange(3.0), "names": np.array(["a", "b"])})
    arrays = read_archive(file, "map", 2, ("x", "names"))
    assert arrays["x"].tolist() == [0, 1, 2]
    assert arrays["names"].tolist() == ["a", "b"]
    assert list(tmp_path.iterdir()) == [file]
    assert arrays["written_by"] == version("pps-vision")


def test_only_named_arrays_count_and_must_be_numbers_or_text(tmp_path):
    file = tmp_path / "a.npz"
    np.savez(file, kind="map", version=2, x=1.0, z=1j)
    arrays = read_archive(file, "map", 2, ("x",))
    assert (arrays["x"], arrays["written_by"]) == (1, "unknown")
    with pytest.raises(InputError, match="z holds complex128"):
        read_archive(file, "map", 2, ("z",))
    file.write_bytes(b"PK\x03\x04 broken")
    with pytest.raises(InputError, match=r"a\.npz: is not a readable"):
        read_archive(file, "map", 2, ("x",))

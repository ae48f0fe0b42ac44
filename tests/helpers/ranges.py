"""Ranges of parameters."""

from collections.abc import Callable, Iterable
from typing import Any

import pytest

from pps_vision.errors import InputError


def check_range(
    params: Callable[..., Any], name: str, refused: Iterable[Any], taken: Iterable[Any], said: Callable[[Any], str]
) -> None:
    """Values outside of a parameter's range are refused with what is `said` (a pattern); those in it are kept."""
    for value in refused:
        with pytest.raises(InputError, match=said(value)):
            params(**{name: value})
    for value in taken:
        assert getattr(params(**{name: value}), name) == value

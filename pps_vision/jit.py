"""numba.njit for functions that are cached on disk, or compiled in memory where no place for the cache is writable."""

import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numba

from pps_vision.errors import InputError

if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
    raise InputError("NUMBA_DISABLE_JIT", "is set; expected it unset: functions that are not compiled overflow")


def _njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """`numba.njit` with these options; without a writable place for its cache it says so once and does without."""

    def compile_function(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(**options)(function)
        except RuntimeError as error:
            if not options.get("cache") or "no locator available" not in str(error):
                raise
            warnings.warn(
                "neither the package's folders nor the home folder are writable: functions are compiled anew at "
                "every start; name a folder for them in NUMBA_CACHE_DIR",
                stacklevel=1,
            )
            return numba.njit(**{**options, "cache": False})(function)

    return compile_function


if TYPE_CHECKING:
    from numba import njit as njit
else:
    njit = _njit

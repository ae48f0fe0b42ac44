"""Dataclasses that can be changed."""

import pkgutil
from dataclasses import is_dataclass
from importlib import import_module


def changeable_dataclasses(package: str) -> list[str]:
    """Names of the dataclasses of a package's own modules (not of the packages in it) that are not frozen."""
    modules = [one.name for one in pkgutil.iter_modules(import_module(package).__path__) if not one.ispkg]
    found = [vars(import_module(f"{package}.{name}")).values() for name in modules]
    return sorted(
        {
            one.__qualname__
            for values in found
            for one in values
            if isinstance(one, type) and is_dataclass(one) and one.__module__.rpartition(".")[0] == package
            if not one.__dataclass_params__.frozen  # type: ignore[attr-defined]
        }
    )

"""The house of the design: who may import whom, and which modules the core's __init__ loads."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LEAVES = ("rendering", "tracking", "learning", "control")
FOR_LEAVES = (
    *("pps_vision.types", "pps_vision.errors", "pps_vision.files", "pps_vision.jit", "pps_vision.parent"),
    *("pps_vision.geometry", "pps_vision.robot"),
)


def imported_modules(file: Path) -> set[str]:
    """Modules that a file imports; `from a import b` counts as a.b, which may be a module."""
    modules = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import"
            modules |= {f"{node.module}.{alias.name}" for alias in node.names}
    return modules


def is_within(module: str, packages: tuple[str, ...]) -> bool:
    return any(module == package or module.startswith(package + ".") for package in packages)


def forbidden(file: Path) -> set[str]:
    """Imports of a file that the design does not allow."""
    package, *path = file.relative_to(ROOT).with_suffix("").parts
    ours = {m for m in imported_modules(file) if is_within(m, ("pps_vision", *LEAVES))}
    if package in LEAVES:
        return {m for m in ours if not is_within(m, (package, *FOR_LEAVES))}
    if path == ["app", "cli", "bench"]:
        return set()
    if path[0] == "app":
        return {m for m in ours if is_within(m, ("pps_vision.experiments",))}
    if path[0] in ("experiments", "testing", "__init__"):
        return set()
    if path[0] == "types":
        return ours | {
            m for m in imported_modules(file) if not is_within(m, ("dataclasses", "enum", "typing", "numpy"))
        }
    if path[0] == "__main__":
        return {m for m in ours if not is_within(m, ("pps_vision.app.cli", "pps_vision.parent"))}
    return {m for m in ours if not is_within(m, (*FOR_LEAVES, f"pps_vision.{path[0]}"))}


FILES = [file for package in ("pps_vision", *LEAVES) for file in sorted((ROOT / package).rglob("*.py"))]


def module_name(file: Path) -> str:
    parts = file.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def circles(imports: dict[str, set[str]]) -> set[str]:
    """Modules on or between import cycles, found by repeatedly removing modules without imports, or without importers,
    among the remaining ones."""
    remaining = set(imports)
    while leaves := {m for m in remaining if not imports[m] & remaining}:
        remaining -= leaves
    while tops := remaining - {name for m in remaining for name in imports[m]}:
        remaining -= tops
    return remaining


def test_modules_import_each_other_in_no_circle():
    """Imports inside functions and for types only count as well."""
    files = {module_name(file): file for file in FILES}
    imports = {}
    for module, file in files.items():
        names = {name if name in files else name.rpartition(".")[0] for name in imported_modules(file)}
        imports[module] = names & files.keys() - {module}
    assert circles(imports) == set()
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b", "d"}, "d": set()}) == {"b", "c"}


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(ROOT)))
def test_imports_keep_to_the_house(file):
    assert forbidden(file) == set()


def test_the_core_imports_nothing_else():
    code = "import sys, pps_vision; print([m for m in sys.modules if m.split('.')[0] in sys.argv[1:]])"
    command = [sys.executable, "-c", code, "pps_vision", *LEAVES, "numpy", "torch"]
    out = subprocess.run(command, capture_output=True, text=True, check=True, cwd="/").stdout
    assert out.strip() == "['pps_vision']"


def test_no_other_import_package_at_the_root():
    packages = {p.parent.name for p in ROOT.glob("*/__init__.py")}
    assert packages - {"tests"} == {"pps_vision", *LEAVES}


def test_rendering_asks_for_no_display():
    """A bare Debian has no libraries of X, which pyglet loads unless it is told that there is no display."""
    code = "import rendering, pyglet; assert pyglet.options['headless'], pyglet.options"
    environment = {name: value for name, value in os.environ.items() if name != "PYGLET_HEADLESS"}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)

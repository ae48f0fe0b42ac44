"""Rules of CONTRIBUTING for every file, read from the sources."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("pps_vision", "rendering", "tracking", "learning", "control")
MUTABLE = {"registry.py": {"HomeReturn"}, "renderer.py": {"Node"}}
"""Dataclasses that a reader, a renderer or an encounter works on, and hands to nobody."""


def decorated(name: str) -> Iterator[tuple[Path, str, dict[str, object]]]:
    """File, name and options of every class and function with a decorator, except in studies."""
    for file in sorted(file for package in PACKAGES for file in (ROOT / package).rglob("*.py")):
        text = file.read_text() if "experiments" not in file.parts else ""
        for node in ast.walk(ast.parse(text)) if f"@{name}" in text else ():
            for decorator in getattr(node, "decorator_list", ()):
                if ast.unparse(getattr(decorator, "func", decorator)) == name:
                    keywords = getattr(decorator, "keywords", ())
                    options = {str(keyword.arg): ast.literal_eval(keyword.value) for keyword in keywords}
                    yield file, node.name, options


def test_messages_params_and_states_cannot_be_changed():
    dataclasses = list(decorated("dataclass"))
    assert len(dataclasses) > 100
    assert [(file.name, name) for file, name, options in dataclasses if not options.get("slots", True)] == []
    changeable = {(file.name, name) for file, name, options in dataclasses if not options.get("frozen")}
    assert changeable == {(file, name) for file, names in MUTABLE.items() for name in names}


def test_what_is_compiled_is_kept_on_disk():
    """Else every start of a command takes a minute."""
    functions = list(decorated("njit"))
    assert len(functions) > 20
    assert [(file.name, name) for file, name, options in functions if options.get("cache") is not True] == []


def test_what_is_counted_together_is_of_one_length():
    """Every `zip` of the algorithms is strict."""
    folders = ("tracking", "learning", "control", "pps_vision/geometry")
    files = [file for folder in folders for file in (ROOT / folder).rglob("*.py")]
    calls = [node for file in files for node in ast.walk(ast.parse(file.read_text())) if isinstance(node, ast.Call)]
    zips = [ast.unparse(call) for call in calls if ast.unparse(call.func) == "zip"]
    assert len(zips) > 20
    assert [call for call in zips if not call.endswith("strict=True)")] == []

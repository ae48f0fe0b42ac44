"""Random mutations of the statements of a source tree."""

import ast
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

PACKAGES, SHARE_OF_EXPERIMENTS = ("pps_vision", "rendering", "tracking", "learning", "control"), 0.1
_SWAPS = {
    **{"Lt": "LtE Gt", "LtE": "Lt GtE", "Gt": "GtE Lt", "GtE": "Gt LtE", "Eq": "NotEq", "NotEq": "Eq", "In": "NotIn"},
    **{"NotIn": "In", "Is": "IsNot", "IsNot": "Is", "And": "Or", "Or": "And", "Add": "Sub", "Sub": "Add"},
    **{"Pow": "Mult", "Mult": "Div", "Div": "Mult", "FloorDiv": "Mult", "Mod": "Mult", "USub": "UAdd"},
}
_DROPPED = ast.Expr | ast.AugAssign | ast.Raise | ast.Continue | ast.Break | ast.Delete


def _of_node(node: Any) -> Iterator[tuple[Any, str]]:
    """Nodes (this one or its condition) and what may stand in their place."""
    for holder, key in [(vars(node), "op"), *((node.ops, k) for k in range(len(getattr(node, "ops", ()))))]:
        old: Any = holder.get(key) if isinstance(holder, dict) else holder[key]
        for name in _SWAPS.get(type(old).__name__, "").split():
            holder[key] = getattr(ast, name)()
            yield node, ast.unparse(node) if isinstance(node, ast.stmt) else f"({ast.unparse(node)})"
            holder[key] = old
    if isinstance(node, ast.Constant) and isinstance(value := node.value, bool | int | float):
        more: object = value + 1 if isinstance(value, int) else value * 1.5 or 1.0
        yield node, str(not value) if isinstance(value, bool) else f"({more})"
    for condition in node.ifs if isinstance(node, ast.comprehension) else [getattr(node, "test", None)]:
        if condition is not None:
            yield condition, f"(not ({ast.unparse(condition)}))"
    to_place = isinstance(node, ast.Assign) and not isinstance(node.targets[0], ast.Name | ast.Tuple)
    if isinstance(node, ast.Return) and ast.unparse(node) not in ("return", "return None"):
        yield node, "return None"
    elif to_place or (isinstance(node, _DROPPED) and not isinstance(getattr(node, "value", None), ast.Constant)):
        yield node, "pass"


def mutations(statement: ast.stmt) -> list[tuple[Any, str]]:
    """Mutations of the nodes of a statement, not of those in it, of annotations or of messages."""
    found, nodes = list[tuple[Any, str]](), list[Any]([statement])
    for node in nodes:  # which grows
        found += _of_node(node)
        parts = vars(node) | {"annotation": None, "returns": None}
        if not isinstance(node, ast.Raise | ast.JoinedStr):
            inner = [one for part in parts.values() for one in (part if isinstance(part, list) else [part])]
            nodes += [one for one in inner if isinstance(one, ast.AST) and not isinstance(one, ast.stmt)]
    return found


def draw(root: Path, n: int, seed: int) -> list[dict[str, Any]]:
    """`n` different mutants of the packages below a folder: file, line, mutation and source of each."""
    rng, statements, drawn = random.Random(seed), list[tuple[float, Path, ast.stmt]](), dict[Any, dict[str, Any]]()
    for file in sorted(file for package in PACKAGES for file in (root / package).rglob("*.py")):
        weight = SHARE_OF_EXPERIMENTS if "experiments" in file.parts else 1.0
        statements += [(weight, file, s) for s in ast.walk(ast.parse(file.read_text())) if isinstance(s, ast.stmt)]
    weights = [weight for weight, _, _ in statements]
    while len(drawn) < n:
        _, file, statement = rng.choices(statements, weights)[0]
        if found := mutations(statement):
            node, other = rng.choice(found)
            lines = file.read_bytes().splitlines(keepends=True)
            start = sum(map(len, lines[: node.lineno - 1])) + node.col_offset
            end = sum(map(len, lines[: node.end_lineno - 1])) + node.end_col_offset
            source = (file.read_bytes()[:start] + other.encode() + file.read_bytes()[end:]).decode()
            what = {"line": node.lineno, "mutation": f"{ast.unparse(node)} -> {other}", "source": source}
            drawn[file, source] = {"file": str(file.relative_to(root)), **what}
    return list(drawn.values())

"""Random mutations of the statements of a source tree."""

import ast
import random
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

PACKAGES = ("pps_vision", "rendering", "tracking", "learning", "control")
SHARE_OF_EXPERIMENTS = 0.1
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
    replacements = list[tuple[Any, str]]()
    nodes = list[Any]([statement])
    for node in nodes:  # which grows
        replacements += _of_node(node)
        parts = vars(node) | {"annotation": None, "returns": None}
        if not isinstance(node, ast.Raise | ast.JoinedStr):
            inner = [child for part in parts.values() for child in (part if isinstance(part, list) else [part])]
            nodes += [child for child in inner if isinstance(child, ast.AST) and not isinstance(child, ast.stmt)]
    return replacements


def draw(root: Path, n: int, seed: int, folders: Sequence[str] = PACKAGES) -> list[dict[str, Any]]:
    """Draw `n` different mutants of the files below `folders` of a tree.

    Returns: One dictionary each: file, line, text (the source line, stripped), mutation, and source (the whole file).
    """
    rng = random.Random(seed)
    statements = list(_statements(root, folders))
    weights = [SHARE_OF_EXPERIMENTS if "experiments" in file.parts else 1.0 for file, _ in statements]
    drawn = dict[Any, dict[str, Any]]()
    while len(drawn) < n:
        file, statement = rng.choices(statements, weights)[0]
        if choices := mutations(statement):
            mutant = _mutant(root, file, *rng.choice(choices))
            drawn[mutant["file"], mutant["source"]] = mutant
    return list(drawn.values())


def replay(root: Path, mutants: Sequence[dict[str, Any]], folders: Sequence[str] = PACKAGES) -> list[dict[str, Any]]:
    """Return those of earlier `mutants` whose source line still stands in a tree, in the same file if it does."""
    wanted = {(mutant["text"], mutant["mutation"]) for mutant in mutants}
    texts = {text for text, _ in wanted}
    present = dict[Any, list[dict[str, Any]]]()
    for file, statement in _statements(root, folders):
        lines = file.read_text().splitlines()
        if any(line.strip() in texts for line in lines[statement.lineno - 1 : statement.end_lineno]):
            for node, replacement in mutations(statement):
                mutant = _mutant(root, file, node, replacement)
                if (key := (mutant["text"], mutant["mutation"])) in wanted:
                    present.setdefault(key, []).append(mutant)
    replayed = []
    for mutant in mutants:
        places = present.get((mutant["text"], mutant["mutation"]), [])
        replayed += sorted(places, key=lambda place: place["file"] != mutant["file"])[:1]
    return replayed


def _statements(root: Path, folders: Sequence[str]) -> Iterator[tuple[Path, ast.stmt]]:
    """Yield every statement of the Python files below `folders`, with its file."""
    for file in sorted(file for folder in folders for file in (root / folder).rglob("*.py")):
        yield from ((file, node) for node in ast.walk(ast.parse(file.read_text())) if isinstance(node, ast.stmt))


def _mutant(root: Path, file: Path, node: Any, replacement: str) -> dict[str, Any]:
    """Return the mutant in which `replacement` stands in place of a node."""
    content = file.read_bytes()
    lines = content.splitlines(keepends=True)
    start = sum(map(len, lines[: node.lineno - 1])) + node.col_offset
    end = sum(map(len, lines[: node.end_lineno - 1])) + node.end_col_offset
    return {
        "file": str(file.relative_to(root)),
        "line": node.lineno,
        "text": lines[node.lineno - 1].decode().strip(),
        "mutation": f"{ast.unparse(node)} -> {replacement}",
        "source": (content[:start] + replacement.encode() + content[end:]).decode(),
    }

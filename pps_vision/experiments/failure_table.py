"""The break points as a table for docs/failure_map.md: `python -m pps_vision.experiments.failure_table [JSON]`."""

import json
import sys
from pathlib import Path
from typing import Any


def table(numbers: dict[str, Any]) -> str:
    """Markdown from what `bench failures` wrote: where each method breaks (and, in brackets, degrades)."""
    cases = numbers["cases"]
    methods = list(next(iter(cases.values()))["methods"])
    lines = ["| disturbance | tried | " + " | ".join(methods) + " |", "|---" * (2 + len(methods)) + "|"]
    for name, case in cases.items():
        tried = ", ".join(f"{value:g}" for value in case["severities"])
        cells = [_cell(case["methods"][method]) for method in methods]
        lines.append(f"| {name}: {case['axis']} | {tried} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _cell(method: dict[str, Any]) -> str:
    breaks, degrades = method["breaks_at"], method["degrades_at"]
    return ("–" if breaks is None else f"{breaks:g}") + ("" if degrades is None else f" ({degrades:g})")


if __name__ == "__main__":
    print(table(json.loads(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/results/failures.json").read_text())))

"""Random mutants of the packages, and whether a test notices: `python -m tests.mutants --seed 7 --out FILE.json`.

A copy of the tree with one mutation runs what holds for every file and the module's own tests, then tests that import
it, then its folder's, for `--seconds` (unmutated).  The mutant is killed if one fails; if they take five times
as long it is out of time, which on a busy machine is to be tried again.  Who judges a survivor equivalent enters the
reason under "judged".
"""

import argparse
import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from shutil import copytree, ignore_patterns, rmtree
from tempfile import TemporaryDirectory
from typing import Any

from tests.helpers.mutations import PACKAGES, SHARE_OF_EXPERIMENTS, draw, replay


def tests_of(root: Path, file: str) -> list[str]:
    """The test files of a tree: of every file's conventions, those named like a module, those importing it or the
    public names, its folder's, the others; each kind ordered by how often it names the module."""
    path = Path(file)
    folder, stem = path.parent.name, path.stem.replace("__init__", path.parent.name)
    package = ".".join(path.parts[:-1] if path.stem != "__init__" else path.parts[:-2])
    from_package = rf"from {package}\.{stem}\b|from {package} import \(?[\w, \n]*\b{stem}\b"
    imported = re.compile(rf"{from_package}|import {path.parts[0]} as ")

    def rank(test: Path) -> tuple[Any, ...]:
        text, is_near = test.read_text(), folder == test.parent.name or test.parent.name in path.parts
        named = len(re.findall(stem.replace("_", "|"), text))
        is_own = is_near and test.stem == f"test_{stem}"
        of_all = test.stem == "test_conventions"
        return not of_all, not is_own, not imported.search(text), not is_near, -named, test

    tests = [test for test in (root / "tests").rglob("test_*.py") if test.name != "test_wheel.py"]
    return [str(test.relative_to(root)) for test in sorted(tests, key=rank)]


def outcome(copy: Path, tests: list[str], limit_s: float, compiled: str = "compiled") -> str:
    """ "survived" if no test of these files fails, "killed" if one does, "out of time" if they take longer; `compiled`:
    the folder of numba's cache."""
    words = ["timeout", "-k", "1", f"{limit_s}", sys.executable, "-m", "pytest", "-xp", "no:cacheprovider", *tests]
    env = {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1", "NUMBA_CACHE_DIR": str(copy / compiled)}
    env = os.environ | env
    done = subprocess.run(words, cwd=copy, env=env, capture_output=True, start_new_session=True)
    return {0: "survived", 5: "survived", 124: "out of time", 137: "out of time"}.get(done.returncode, "killed")


def without_dependents(copy: Path, file: str) -> str:
    """A copy of numba's cache without what depends on a file, of which numba knows nothing."""
    texts = {path: path.read_text() for package in PACKAGES for path in (copy / package).rglob("*.py")}
    stale, reached = set[Path](), {copy / file}
    while reached - stale:
        path = (reached - stale).pop()
        stale.add(path)
        parts = path.relative_to(copy).with_suffix("").parts
        package, stem = ".".join(parts[:-1]), parts[-1]
        imported = re.compile(rf"from {package}\.{stem} |from {package} import \(?[\w, \n]*\b{stem}\b")
        reached |= {other for other, text in texts.items() if imported.search(text)}
    left_out = ignore_patterns(*(f"{path.stem}.*" for path in stale))
    name = f"compiled-{time.time_ns()}"
    copytree(copy / "compiled", copy / name, ignore=left_out, copy_function=os.link)
    return name


def tried(copy: Path, mutant: dict[str, Any], tests: list[str], seconds: dict[str, float], most_s: float) -> str:
    """Outcome of a mutant in a copy; `seconds`: processor time of each test file unmutated, 0 for one that fails."""
    place = copy / mutant["file"]
    for batch in tests[:2], tests[2:]:
        used = list[str]()
        while batch and sum(seconds[test] for test in used) < most_s:
            start, (test, *batch) = sum(os.times()[:4]), batch
            if test not in seconds:
                seconds[test] = (outcome(copy, [test], 600) == "survived") * round(sum(os.times()[:4]) - start, 1)
            used += [test] if seconds[test] else []
        kept = place.rename(copy / "kept")  # with its time, by which numba knows what it has compiled
        place.write_text(mutant["source"])
        compiled = without_dependents(copy, mutant["file"])
        found = outcome(copy, used, 60 + 5 * sum(seconds[test] for test in used), compiled) if used else "survived"
        rmtree(copy / compiled)
        kept.rename(place)
        if found != "survived":
            break
    return found


def main() -> None:
    """Try mutants; the file is written after each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=112, help="number of mutants to draw")
    parser.add_argument("--seed", type=int, default=0, help="seed of the draw")
    parser.add_argument("--only", nargs="+", default=PACKAGES, metavar="FOLDER", help="mutate only files below these")
    parser.add_argument(
        "--from", dest="earlier", type=Path, metavar="FILE.json", help="replay a round where its lines still exist"
    )
    parser.add_argument("--out", type=Path, required=True, help="JSON file for the outcomes")
    parser.add_argument(
        "--seconds", type=float, default=90.0, help="processor time of its tests, after its module's own"
    )
    parser.add_argument("--root", type=Path, default=Path(__file__).parents[1], help="the tree")
    parser.add_argument("--resume", action="store_true", help="continue an interrupted round")
    words = parser.parse_args()
    results: dict[str, Any] = {"seed": words.seed, "share_of_experiments": SHARE_OF_EXPERIMENTS, "seconds": {}}
    results = json.loads(words.out.read_text()) if words.resume else {**results, "mutants": []}
    if words.earlier:
        chosen = replay(words.root, json.loads(words.earlier.read_text())["mutants"], words.only)
    else:
        chosen = draw(words.root, words.n, words.seed, words.only)
    os.environ.setdefault("PPS_VISION_DATA", str(words.root.parent / "shared/data"))
    with TemporaryDirectory() as folder:
        copy = copytree(words.root, Path(folder, "tree"), ignore=ignore_patterns(".*", "demo", "site", "shared"))
        (copy / "compiled").mkdir()
        for mutant in chosen[len(results["mutants"]) :]:
            result = tried(copy, mutant, tests_of(words.root, mutant["file"]), results["seconds"], words.seconds)
            results["mutants"].append(mutant | {"source": None, "outcome": result, "judged": None})
            words.out.write_text(json.dumps(results, indent=1))
            about = [mutant[key] for key in ("file", "line", "mutation")]
            print(f"{len(results['mutants'])}/{len(chosen)}", *about, result, flush=True)


if __name__ == "__main__":
    main()

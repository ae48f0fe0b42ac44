"""Run studies and write their numbers, charts and tables: what `pps-vision bench` does."""

import json
import math
import resource
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from time import perf_counter
from typing import Any

from matplotlib.figure import Figure

from pps_vision.app import versions
from pps_vision.app.report.figure_file import save
from pps_vision.errors import InputError
from pps_vision.experiments.study import Entry, Study, catalogue, load, short_parameters
from pps_vision.experiments.tables import filled, markdown, names, read_numbers
from pps_vision.recordings.outputs import plain, whole_file
from pps_vision.worker_pool import worker_pool

_DOCUMENTS = Path("docs")
_GROUPS = ("pps", "reach")
_MINUTES = "processor_min"
_DENSE = ",", ":"  # separators of JSON


def listing() -> str:
    """Return every study's name, what it measures, and its parameters."""
    lines = []
    for name, entry in catalogue().items():
        fields = ", ".join(f"{field} = {value}" for field, value in entry.fields.items())
        lines.append(f"{name}: {entry.summary}\n    {fields}")
    return "\n".join(lines)


def bench(
    asked: Sequence[str],
    overrides: Mapping[str, Any] = {},
    out: Path = _DOCUMENTS,
    again: bool = False,
    redraw: bool = False,
    short: bool = False,
) -> None:
    """Run the studies that are asked for; with `redraw` only draw and fill what was measured.

    A `short` run takes each study's smallest parameters (`study.SHORT`), where `overrides` give no others. Studies of
    other studies' results come last and read those in `out`.  Of several studies, `workers` of the overrides run at
    once, those that took longest first; one that fails does not stop the others.
    """
    known = catalogue()
    chosen = [name for name in known if any(_is_asked(name, one) for one in asked)]
    workers = 1
    if len(chosen) > 1:
        workers = int(overrides.get("workers", 1))
        overrides = {name: value for name, value in overrides.items() if name != "workers"}
    for one in asked:
        if not any(_is_asked(name, one) for name in known):
            raise InputError(
                "bench", f"no study {one}; expected all, {', '.join(_GROUPS)} or one of {', '.join(known)}"
            )
    for name, value in overrides.items():
        if len(asked) == len(chosen) and not any(name in known[study].fields for study in chosen):
            raise InputError("bench", f"{', '.join(asked)} takes no {name} ({value}); see `bench` without a name")
    commit = versions.commit()
    if out == _DOCUMENTS and not redraw and commit.endswith("dirty"):
        raise InputError("bench", "the code has uncommitted changes; commit them first, or give --out FOLDER")
    if out == _DOCUMENTS and short:
        raise InputError("bench", "a short run measures nothing; give --out FOLDER for its results")
    studies = {}
    for name in chosen:
        fields = known[name].fields
        given = {field: value for field, value in overrides.items() if field in fields}
        given |= {"results": out / "results"} if "results" in fields else {}
        studies[name] = load(known[name])(**(short_parameters(name, known[name]) if short else {}) | given)
    if redraw:
        for name, study in studies.items():
            if (file := _result(name, out)).exists():
                _draw(study, name, read_numbers(file), out)
    else:
        of_results = {name for name in chosen if "results" in known[name].fields}
        longest_first = sorted(set(chosen) - of_results, key=lambda name: (-_minutes(_result(name, out)), name))
        _measure_all({name: studies[name] for name in longest_first}, commit, out, again, workers)
        _measure_all({name: studies[name] for name in chosen if name in of_results}, commit, out, again, 1)
    _fill_documents(known, out)


def _result(name: str, out: Path) -> Path:
    return out / "results" / f"{name}.json"


def _minutes(file: Path) -> float:
    """Processor time of a study when it was measured last; infinite where it was not."""
    return float(json.loads(file.read_text())[_MINUTES]) if file.exists() else math.inf


def _measure_all(studies: Mapping[str, Study], commit: str, out: Path, again: bool, workers: int) -> None:
    """Measure studies, `workers` at once, each in a process of its own; with one, in turn and in this one."""
    if workers == 1:
        for name, study in studies.items():
            _measure(name, study, commit, out, again)
        return
    with worker_pool(workers, max_tasks_per_child=1) as pool:
        done = [pool.submit(_measure, name, study, commit, out, again) for name, study in studies.items()]
    if errors := [error for future in done if (error := future.exception())]:
        for error in errors[1:]:
            print(f"! {error}")
        raise errors[0]


def _is_asked(name: str, asked: str) -> bool:
    return asked in (name, "all") or (asked in _GROUPS and name.startswith(f"{asked}_"))


def _measure(name: str, study: Study, commit: str, out: Path, again: bool) -> None:
    """Run a study and write its result and charts; nothing where this commit has measured the same."""
    file = _result(name, out)
    fields: dict[str, Any] = asdict(study)  # type: ignore[call-overload]
    parameters = {key: value.name if isinstance(value, Path) else value for key, value in fields.items()}
    setting = {"study": name, "parameters": plain(parameters), "machine": versions.machine(commit)}
    again = again or "results" in fields  # which may have changed
    if not again and not commit.endswith(("dirty", "unknown")) and file.exists():
        before = json.loads(file.read_text())
        if all(before.get(key) == value for key, value in setting.items()):
            print(f"= {file} (already measured by this commit with these parameters)")
            return
    begun, begun_s = perf_counter(), _processor_s()
    with whole_file(file) as partial:
        numbers = _rounded(plain(study.run()))
        numbers = {**setting, _MINUTES: _rounded((_processor_s() - begun_s) / 60), **numbers}
        partial.write_text(_compact(numbers))
        _draw(study, name, read_numbers(partial), out)
    missing = f"; skipped: {numbers['skipped']}" if "skipped" in numbers else ""
    print(f"→ {file} ({perf_counter() - begun:.0f} s{missing})", flush=True)


def _processor_s() -> float:
    """Processor time of this process and of those that it has waited for."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def _draw(study: Study, name: str, numbers: dict[str, Any], out: Path) -> None:
    drawn = study.chart(numbers)
    for part, figure in ({"": drawn} if isinstance(drawn, Figure) else drawn).items():
        file = out / "figures" / (f"{name}_{part}.png" if part else f"{name}.png")
        with whole_file(file) as partial:
            save(figure, partial, colors=128)
        print(f"→ {file}")


def _fill_documents(known: Mapping[str, Entry], out: Path) -> None:
    """Fill the marked tables of the documents and of README.md from the results that are there.

    With another folder than the documents' own the filled documents are written there.
    """
    for document in [*sorted(_DOCUMENTS.glob("*.md")), *Path().glob("README.md")]:
        tables, text = {}, document.read_text()
        for name in names(text):
            studies = [study for study in known if name == study or name.startswith(f"{study}_")]
            if not studies:
                raise InputError(document, f"table {name}; expected the name of a study (and of its table)")
            study = max(studies, key=len)
            file = out / "results" / f"{study}.json"
            if file.exists():
                numbers = read_numbers(file)
                of_study, part = load(known[study])().tables(numbers), name[len(study) + 1 :]
                if part in of_study:
                    tables[name] = markdown(of_study[part])
                elif "skipped" not in numbers:
                    raise InputError(document, f"table {name}; expected one of {study}'s: {', '.join(of_study)}")
        target, new = document if out == _DOCUMENTS else out / document.name, filled(text, tables, document)
        if names(text) and not (target.exists() and target.read_text() == new):
            with whole_file(target) as partial:
                partial.write_text(new)


def _compact(numbers: Mapping[str, Any]) -> str:
    """JSON with one line for every name of the outermost level."""
    lines = (
        f"{json.dumps(key)}: {json.dumps(value, ensure_ascii=False, separators=_DENSE)}"
        for key, value in numbers.items()
    )
    return "{\n " + ",\n ".join(lines) + "\n}\n"


def _rounded(value: Any) -> Any:
    """Floats with 5 significant digits."""
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.5g}") if isinstance(value, float) else value

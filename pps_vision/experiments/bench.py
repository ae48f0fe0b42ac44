"""Run studies and write their numbers, charts and tables (`pps-vision bench`)."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from time import perf_counter
from typing import Any, TypeVar

from matplotlib.figure import Figure
from PIL import Image

from pps_vision.app import versions
from pps_vision.app.report.page import save
from pps_vision.errors import InputError
from pps_vision.experiments.claims import claims_table
from pps_vision.experiments.study import PartsStudy, Study, catalogue
from pps_vision.experiments.tables import filled, markdown, names, read_numbers
from pps_vision.recordings.atomic_write import plain, whole_file
from pps_vision.worker_pool import worker_pool

_DOCUMENTS = Path("docs")
_CLAIMS = "claims"
Shown = TypeVar("Shown")


def listing() -> str:
    """Return every study's name, time on one core, summary, parameters and parts."""
    lines = []
    for name, study in catalogue().items():
        parameters = ", ".join(f"{field} = {value!r}" for field, value in study.defaults().items())
        parts = f"; parts: {', '.join(study.PARTS)}" if issubclass(study, PartsStudy) else ""
        lines.append(f"{name} ({study.MINUTES} min): {study.summary()}\n    {parameters}{parts}")
    return "\n".join(lines)


def bench(
    requested: Sequence[str],
    overrides: Mapping[str, Any] = {},
    out: Path = _DOCUMENTS,
    again: bool = False,
    redraw: bool = False,
    short: bool = False,
) -> None:
    """Run the named studies; with `redraw` only draw charts and fill tables from their results.

    A `short` run takes each study's smallest parameters (`Study.SHORT`), unless `overrides` give others. With `workers`
    among them, several studies run side by side, the longest first; one that fails does not stop the others.
    """
    catalog = catalogue()
    for word in requested:
        if word not in (*catalog, "all"):
            raise InputError("bench", f"no study {word}; expected all or one of {', '.join(catalog)}")
    chosen = [name for name in catalog if name in requested or "all" in requested]
    overrides = dict(overrides)
    workers = int(overrides.pop("workers", 1)) if len(chosen) > 1 else 1
    for name, value in overrides.items():
        if len(requested) == len(chosen) and not any(name in catalog[study].defaults() for study in chosen):
            raise InputError("bench", f"{', '.join(requested)} takes no {name} ({value}); see `bench` without a name")
    commit = versions.commit()
    if out == _DOCUMENTS and not redraw and commit.endswith("dirty"):
        raise InputError("bench", "the code has uncommitted changes; commit them first, or give --out FOLDER")
    if out == _DOCUMENTS and short:
        raise InputError("bench", "a short run measures nothing; give --out FOLDER for its results")
    studies = {name: _with_parameters(catalog[name], overrides, short) for name in chosen}
    if redraw:
        for name, study in studies.items():
            if (file := _result(name, out)).exists():
                _save(_shown(file, study.chart), name, out)
    else:
        _measure_all(studies, commit, out, again, workers)
    _fill_documents(catalog, out)


def _with_parameters(cls: type[Study], overrides: Mapping[str, Any], short: bool) -> Study:
    parameters = {name: value for name, value in overrides.items() if name in cls.defaults()}
    return cls(**(cls.short() if short else {}) | parameters)


def _result(name: str, out: Path) -> Path:
    return out / "results" / f"{name}.json"


def _shown(file: Path, show: Callable[[dict[str, Any]], Shown]) -> Shown:
    """Return charts or tables of the results of an earlier run.

    Raises:
        InputError: The results lack what this version shows.
    """
    numbers = read_numbers(file)
    try:
        return show(numbers)
    except (KeyError, TypeError, AttributeError, ValueError, IndexError) as error:
        reason = f"not the results of this version ({type(error).__name__}: {error})"
        raise InputError(file, f"{reason}; expected all parts measured again, or another --out") from error


def _measure_all(studies: Mapping[str, Study], commit: str, out: Path, again: bool, workers: int) -> None:
    """Measure studies in `workers` processes, the longest first; a single worker is this process."""
    if workers == 1:
        for name, study in studies.items():
            _measure(name, study, commit, out, again)
        return
    longest_first = sorted(studies.items(), key=lambda item: -item[1].MINUTES)
    with worker_pool(workers, max_tasks_per_child=1) as pool:
        futures = [pool.submit(_measure, name, study, commit, out, again) for name, study in longest_first]
    errors = [error for future in futures if (error := future.exception())]
    for error in errors[1:]:
        print(f"! {error}")
    if errors:
        raise errors[0]


def _measure(name: str, study: Study, commit: str, out: Path, again: bool) -> None:
    """Run a study, part by part, and write result and charts; skip parts that this commit has measured with the same
    parameters."""
    file = _result(name, out)
    fields = {key: value.name if isinstance(value, Path) else value for key, value in asdict(study).items()}
    fields.pop("parts", None)
    setting = {"parameters": plain(fields), "machine": versions.machine(commit)}
    again = again or commit.endswith(("dirty", "unknown"))
    results = read_numbers(file)
    for part, task in (study.tasks() if isinstance(study, PartsStudy) else {"": study.run}).items():
        measured = results.get(part) if part else results
        label = f"{file}, {part}" if part else f"{file}"
        if not again and isinstance(measured, dict) and setting.items() <= measured.items():
            print(f"= {label} (already measured by this commit with these parameters)")
            continue
        start = perf_counter()
        numbers = {**setting, **_rounded(plain(task()))}
        if isinstance(study, PartsStudy):
            results[part] = numbers
            numbers = {key: results[key] for key in study.PARTS if key in results}
        with whole_file(file) as partial:
            partial.write_text(_json(plain({"study": name, **numbers}), levels=2 if part else 1) + "\n")
            written = read_numbers(partial)
            fresh = {part: written[part]} if part else written
            study.tables(fresh)  # an error here is a bug, not that of an earlier result
            _save(study.chart(fresh), name, out)
        run = written[part] if part else written
        skipped = run.get("skipped") or run.get("not_measured")
        missing = f"; skipped: {skipped}" if skipped else ""
        print(f"→ {label} ({perf_counter() - start:.0f} s{missing})", flush=True)


def _save(drawn: Figure | dict[str, Figure], name: str, out: Path) -> None:
    for part, figure in ({"": drawn} if isinstance(drawn, Figure) else drawn).items():
        file = out / "figures" / (f"{name}_{part}.png" if part else f"{name}.png")
        with whole_file(file) as partial:
            save(figure, partial)
            with Image.open(partial) as image:
                image.convert("RGB").quantize(128, dither=Image.Dither.NONE).save(partial, "PNG", optimize=True)
        print(f"→ {file}")


def _fill_documents(catalog: Mapping[str, type[Study]], out: Path) -> None:
    """Fill the marked tables of the documents and README.md from the results in `out`.

    If `out` is not the documents' folder, the filled documents are written to it.
    """
    documents = {file: file.read_text() for file in (*sorted(_DOCUMENTS.glob("*.md")), *Path().glob("README.md"))}
    tables = {_CLAIMS: claims_table(out / "results")}
    for study, cls in catalog.items():
        if (file := _result(study, out)).exists():
            own = _shown(file, cls().tables)
            tables |= {f"{study}_{name}" if name else study: table for name, table in own.items()}
    for document, text in documents.items():
        for name in names(text):
            if name != _CLAIMS and not any(f"{name}_".startswith(f"{study}_") for study in catalog):
                raise InputError(document, f"table {name}; expected the name of a study and of its table")
        target = document if out == _DOCUMENTS else out / document.name
        new = filled(text, {name: markdown(table) for name, table in tables.items()}, document)
        if names(text) and not (target.exists() and target.read_text() == new):
            with whole_file(target) as partial:
                partial.write_text(new)


def _json(value: Any, levels: int, indent: str = "") -> str:
    """JSON with one line for every name of the outermost levels."""
    if levels == 0 or not isinstance(value, dict):
        return json.dumps(value, ensure_ascii=False, separators=(",", ":"))
    items = (f"{indent} {json.dumps(key)}: {_json(item, levels - 1, indent + ' ')}" for key, item in value.items())
    return "{\n" + ",\n".join(items) + f"\n{indent}}}"


def _rounded(value: Any) -> Any:
    """Floats with 5 significant digits."""
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.5g}") if isinstance(value, float) else value

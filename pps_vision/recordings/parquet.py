"""Tables as Apache Parquet (extra `parquet`)."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pps_vision.errors import InputError


def write_parquet(file: Path, columns: Mapping[str, type], rows: Sequence[Mapping[str, object]]) -> None:
    """Write rows with columns of str, int or float; None is a missing value."""
    pa = require_pyarrow()
    kinds = {str: pa.string(), int: pa.int64(), float: pa.float64()}
    schema = pa.schema([(name, kinds[kind]) for name, kind in columns.items()])
    pa.parquet.write_table(pa.Table.from_pylist([dict(row) for row in rows], schema=schema), file)


def require_pyarrow() -> Any:
    """The package that writes Parquet; InputError where it is not installed."""
    try:
        import pyarrow.parquet
    except ImportError as error:
        raise InputError(
            "batch", "--parquet needs pyarrow; expected the extra: pip install 'pps-vision[parquet]'"
        ) from error
    return pyarrow

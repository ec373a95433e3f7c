"""The file of a study: a Parquet file that is always whole, and beside it a journal of the rows since.

A row is in the journal, one line of JSON, before the next is waited for. A study that was killed goes on from both.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pbd_warp import check
from pbd_warp.atomic import replacing
from pbd_warp.errors import InputError
from pbd_warp.study.rows import Row

try:
    import fcntl
except ImportError:  # Windows: two studies to one file are then not noticed
    fcntl = None  # type: ignore[assignment]

KEY = b"pbd-warp study"
"""In the Parquet file's metadata: what it is a study of, as JSON."""


class Store:
    """The rows of a study on the disk.

    Args:
        path: A .parquet file.
        identity: What the study is of: two with the same have the same rows.

    Attributes:
        rows: All there are, by number.

    Raises:
        InputError: the file cannot be written, is of another study, or another process is writing it.
    """

    def __init__(self, path: Path, identity: Mapping[str, Any]):
        if path.suffix != ".parquet":
            raise InputError(f"a study is written as .parquet, not {str(path)!r}")
        check.folder(path.parent)
        check_libraries()
        self.path = path
        self._identity = json.loads(json.dumps(identity))
        self._journal_path = path.with_name(path.name + ".rows")
        self.rows: dict[int, Row] = {}
        if path.exists():
            table, theirs = _read(path)
            self._refuse_other(theirs)
            self.rows = {row["row"]: row for row in table.to_pylist()}
        self._journal = open(self._journal_path, "a+b")  # noqa: SIM115 it is open as long as the store
        if fcntl is not None:
            try:
                fcntl.flock(self._journal, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                self._journal.close()
                raise InputError(f"another study is writing to {path}: wait for it, or name another --out") from None
            except OSError:
                pass  # a file system without locks
        self._read_journal()

    def add(self, rows: Iterable[Row]) -> None:
        """Keep rows, from now on whatever happens to this process."""
        rows = list(rows)
        self._journal.write(b"".join(json.dumps(row).encode() + b"\n" for row in rows))
        self._journal.flush()
        self.rows |= {row["row"]: row for row in rows}

    def close(self) -> None:
        """Write the Parquet file with all rows; the journal is then not needed."""
        try:
            if self.rows:
                _write(self.path, self.rows, self._identity)
                os.fsync(self._journal.fileno())
            self._journal_path.unlink()
        finally:
            self._journal.close()

    def _read_journal(self) -> None:
        self._journal.seek(0)
        lines = self._journal.read().split(b"\n")
        whole = sum(len(line) + 1 for line in lines[:-1])
        self._journal.truncate(whole)  # what a kill has left of a line
        if not whole:
            self._journal.write(json.dumps(self._identity).encode() + b"\n")
            self._journal.flush()
            return
        try:
            theirs, *rows = (json.loads(line) for line in lines[:-1])
            if not isinstance(theirs, dict):
                raise ValueError
            self._refuse_other(theirs)
            self.rows |= {row["row"]: row for row in rows}
        except (ValueError, KeyError, TypeError):
            raise InputError(f"{self._journal_path} is damaged: remove it, and its rows are made again") from None

    def _refuse_other(self, theirs: Mapping[str, Any]) -> None:
        for name, ours in self._identity.items():
            if theirs.get(name) != ours:
                raise InputError(
                    f"{self.path} is of another study: its {name} is {_short(theirs.get(name))}, not {_short(ours)}; "
                    "name another file"
                )


def load(path: Path) -> Any:
    """The rows of a study, a pandas DataFrame."""
    return _read(path)[0].to_pandas()


def columns(rows: Mapping[int, Row]) -> list[str]:
    """All columns, in the order of the rows' numbers; where and how long last, as failed rows may lack some."""
    names: dict[str, None] = {}
    for number in sorted(rows, key=lambda number: (-len(rows[number]), number)):
        names |= dict.fromkeys(rows[number])
    last = [name for name in ("wall_s", "together", "machine", "device") if name in names]
    return [*(name for name in names if name not in last), *last]


def _write(path: Path, rows: Mapping[int, Row], identity: Mapping[str, Any]) -> None:
    import pyarrow.parquet

    order = sorted(rows)
    table = pyarrow.table({name: _column([rows[number].get(name) for number in order]) for name in columns(rows)})
    table = table.replace_schema_metadata({KEY: json.dumps(identity).encode()})
    with replacing(path) as temporary:
        pyarrow.parquet.write_table(table, temporary)


def _read(path: Path) -> tuple[Any, dict[str, Any]]:
    check_libraries()
    import pyarrow.parquet

    try:
        table = pyarrow.parquet.read_table(path)
        identity = json.loads((table.schema.metadata or {})[KEY])
    except (OSError, KeyError, ValueError) as error:
        raise InputError(f"{path} is no study of pbd-warp: {str(error).splitlines()[0]}") from None
    return table, identity


def _column(values: list[Any]) -> list[Any]:
    """All texts where one is: numbers beside "auto"."""
    if not any(isinstance(value, str) for value in values):
        return values
    return [None if value is None else str(value) for value in values]


def check_libraries() -> None:
    """Raise an InputError where there is no library for tables."""
    try:
        import pandas  # noqa: F401
        import pyarrow  # noqa: F401
    except ImportError:
        raise InputError("studies need pandas and pyarrow: pip install 'pbd-warp[scale]'") from None


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."

"""Tables as CSV files: the rows are dataclasses of texts, whole numbers and numbers, their info leads as comments."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from pbd_warp import check
from pbd_warp.atomic import replacing
from pbd_warp.errors import InputError

NOUNS = {str: "text", int: "a whole number", float: "a number"}


class TableRow:
    """Base of a frozen dataclass (with eq=False) whose fields are the columns of a table, each a str, int or float.

    Rows are equal if they are written alike, so that nan equals nan.
    """

    @classmethod
    def parsers(cls) -> dict[str, Any]:
        """The type of each column, in their order."""
        types = {"str": str, "int": int, "float": float}
        return {field.name: types[str(field.type)] for field in fields(cls)}  # type: ignore[arg-type]

    def cells(self) -> tuple[str, ...]:
        """The row as text, one a column; repr keeps every bit of a float."""
        values = [parse(getattr(self, name)) for name, parse in self.parsers().items()]
        return tuple(repr(value) if isinstance(value, float) else str(value) for value in values)

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self.cells() == other.cells()

    def __hash__(self) -> int:
        return hash(self.cells())


def save_table(what: str, columns: Iterable[str], rows: Iterable[TableRow], info: Mapping[str, str], path: Any) -> None:
    """Write rows as CSV, the info as leading lines `# key: value`. `what` the table is called in errors.

    Raises:
        InputError: what would not come back as it is.
        SimulationFailed: the file could not be written.
    """
    rows = list(rows)
    for key, value in info.items():
        if ":" in key or key != key.strip() or any(mark in key + value for mark in "\r\n"):
            raise InputError(f"{what}'s info must fit one line 'key: value', not {key!r}: {value!r}")
    for row in rows:
        if any(mark in cell for cell in row.cells() for mark in "\r\n"):
            raise InputError(f"{what}'s row must fit one line, and that of {row.cells()[0]!r} does not")
    with replacing(Path(path)) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        file.writelines(f"# {key}: {value}\n" for key, value in info.items())
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(row.cells() for row in rows)


def load_table(what: str, row_type: Any, path: str | Path) -> tuple[tuple[Any, ...], dict[str, str]]:
    """Read what `save_table` wrote: the rows and the info.

    Raises:
        InputError: the file cannot be read, or is no such table; with the file, the line and what is wrong there.
    """
    try:
        with open(check.ordinary(Path(path)), newline="", encoding="utf-8") as file:
            lines = list(file)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text in UTF-8"
        raise InputError(f"cannot read {what} {path}: {reason}") from None
    info: dict[str, str] = {}
    while len(info) < len(lines) and lines[len(info)].startswith("#"):
        key, colon, value = lines[len(info)].removeprefix("#").rstrip("\r\n").partition(":")
        if not colon or key.strip() in info:
            raise InputError(f"{path}, line {len(info) + 1}: must be '# key: value', with each key once")
        info[key.strip()] = value.removeprefix(" ")
    columns = tuple(row_type.parsers())
    reader = csv.reader(lines[len(info) :])
    try:
        header = next(reader, [])
        if tuple(header) != columns:
            missing = ", ".join(name for name in columns if name not in header)
            but = f"there is no {missing}" if missing else f"they are {', '.join(header)}"
            raise InputError(f"the columns must be {', '.join(columns)}, but {but}")
        rows = tuple(_parse(row_type, cells) for cells in reader if cells)
    except (csv.Error, ValueError) as error:
        raise InputError(f"{path}, line {len(info) + max(1, reader.line_num)}: {error}") from None
    if not rows:
        raise InputError(f"{path}: there are no rows under the columns")
    return rows, info


def _parse(row_type: Any, cells: list[str]) -> Any:
    parsers = row_type.parsers()
    if len(cells) != len(parsers):
        raise InputError(f"there are {len(cells)} values for {len(parsers)} columns")
    values = {}
    for (name, parse), cell in zip(parsers.items(), cells, strict=True):
        try:
            values[name] = parse(cell)
        except ValueError:
            raise InputError(f"{name} must be {NOUNS[parse]}, not {cell!r}") from None
    return row_type(**values)

"""Tables that come in: which columns they have, cells checked, and the first fault placed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import NamedTuple, NoReturn, Protocol

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.types import Indices, Vector


class Column(Protocol):
    """Cells of one column, whatever they were written as."""

    def numbers(self) -> tuple[Vector, int | None]:
        """Values, NaN where a cell is empty or says NaN; and the first row that has no number."""
        ...

    def names(self, known: dict[str, int]) -> tuple[Indices, int | None]:
        """Places of names in `known`, which grows, -1 for empty cells; the first row with none."""
        ...

    def text(self, row: int) -> str:
        """Say what stands in a cell, for a message."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Some rows of a file: its columns, and where each row stands ("line" 17 of `file`)."""

    file: str
    unit: str
    rows: NDArray[np.int64]
    columns: Mapping[str, Column]

    def __len__(self) -> int:
        return int(self.rows.size)

    def where(self, row: int) -> str:
        """Say where row number `row` of these stands."""
        return f"{self.file}, {self.unit} {self.rows[row]}"


class Schema(NamedTuple):
    """Columns of a file: those it must have, and those it may have."""

    required: tuple[str, ...]
    optional: tuple[str, ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """All columns, in the order that we write."""
        return self.required + self.optional

    def __str__(self) -> str:
        return ",".join(self.required) + "".join(f"[,{column}]" for column in self.optional)


class Rule(NamedTuple):
    """What a number must be: not below `least` (not at it either, if `above`), and there."""

    expected: str
    required: bool = True
    least: float = -math.inf
    above: bool = False


class Fault(NamedTuple):
    """A cell that cannot be used, and what was expected there."""

    row: int
    column: str
    expected: str


NUMBER = Rule("a finite number")
OPTIONAL_NUMBER = Rule("a finite number or nothing", required=False)


@dataclass(frozen=True, slots=True, eq=False)
class Checks:
    """Reads columns of one table and keeps what is wrong; `finish` tells the first fault."""

    table: Table
    faults: list[Fault] = field(default_factory=list["Fault"])

    def numbers(self, column: str, rule: Rule = NUMBER) -> Vector:
        """Read a column of numbers; NaN where there is none."""
        cells = self.table.columns.get(column)
        if cells is None:
            return np.full(len(self.table), np.nan)
        values, wrong = cells.numbers()
        if wrong is not None:
            text = ", not text" if _is_number(cells.text(wrong)) else ""
            self.faults.append(Fault(wrong, column, rule.expected + text))
        bad = np.isinf(values) | (values <= rule.least if rule.above else values < rule.least)
        self.refuse(bad | np.isnan(values) if rule.required else bad, column, rule.expected)
        return values

    def names(self, column: str, known: dict[str, int], *, required: bool = True) -> Indices:
        """Read a column of names as places in `known`, which grows; -1 where there is none."""
        cells = self.table.columns.get(column)
        if cells is None:
            return np.full(len(self.table), -1, np.int32)
        places, wrong = cells.names(known)
        if wrong is not None:
            self.faults.append(Fault(wrong, column, "a name"))
        elif required:
            self.refuse(places < 0, column, "a name")
        return places

    def one_of(self, column: str, known: Iterable[str], *, what: str) -> Indices:
        """Read a column of names that must be in `known`; `what` says what they name."""
        known = tuple(known)
        table = {name: place for place, name in enumerate(known)}
        places = self.names(column, table)
        unknown = places >= len(known)
        if unknown.any():
            found = self.table.columns[column].text(int(unknown.argmax()))
            self.refuse(unknown, column, f"{what}; {_nearest(found, known)}")
        return places

    def refuse(self, bad: NDArray[np.bool_], column: str, expected: str) -> None:
        """Keep the first of the `bad` rows, if there is one, as a fault."""
        if bad.any():
            self.faults.append(Fault(int(bad.argmax()), column, expected))

    def finish(self) -> None:
        """Raise `InputError` for the first faulty cell, in order of rows, then of checks."""
        if self.faults:
            row, column, expected = min(self.faults, key=lambda fault: fault.row)
            found = self.table.columns[column].text(row).strip()
            said = f"{found[:60]!r}" if found else "nothing"
            where = self.table.where(row)
            raise InputError(f"{where}: {column}: found {said}, expected {expected}")


def check_columns(found: Iterable[str], schema: Schema, where: str) -> None:
    """Refuse columns that `schema` does not know, miss or come twice, all in one `InputError`."""
    found = list(found)
    problems = [
        f"found an unknown column {column!r}{_meant(column, schema.columns)}"
        for column in dict.fromkeys(found)
        if column not in schema.columns
    ]
    problems += [
        f"found column {column!r} twice"
        for column in dict.fromkeys(found)
        if found.count(column) > 1
    ]
    problems += [f"found no column {column!r}" for column in schema.required if column not in found]
    if problems:
        raise InputError(f"{where}: {', '.join(problems)}, expected {schema}")


def refuse_empty(file: str, schema: Schema) -> NoReturn:
    """Raise the `InputError` of a file without a single row."""
    raise InputError(f"{file}: found no rows, expected at least one of {schema}")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _meant(column: str, known: Sequence[str]) -> str:
    close = get_close_matches(column, known, n=1, cutoff=0.5)
    return f" (nearest valid one: {close[0]})" if close else ""


def _nearest(name: str, known: Iterable[str]) -> str:
    # Imported for a message only: the schema of sites comes with pydantic.
    from trackfield.network.faults import nearest

    return nearest(name.strip(), known)

"""Comma-separated files as tables, block by block."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.io.decimals import PADDING, Bytes, Places, distinct, parse_numbers
from trackfield.io.lines import Block, Progress, line_blocks
from trackfield.io.tables import Column, Schema, Table, check_columns
from trackfield.types import Indices, Vector

_PAD = bytes(PADDING)


@dataclass(frozen=True, slots=True, eq=False)
class TextColumn:
    """Cells, at least one, as bytes `start` to `end` of `buffer`, which goes on for `PADDING`."""

    buffer: Bytes
    start: Places
    end: Places

    def numbers(self) -> tuple[Vector, int | None]:
        """Values, NaN where a cell is empty; and the first row that has no number."""
        return parse_numbers(self.buffer, self.start, self.end)

    def names(self, known: dict[str, int]) -> tuple[Indices, int | None]:
        """Places of names in `known`, which grows; -1 for empty cells."""
        first, which = distinct(self.buffer, self.start, self.end)
        places = np.full(first.size, -1, np.int32)
        for i, row in enumerate(first.tolist()):
            name = self.text(row).strip()
            if not name.isprintable():
                return places[which], row
            if name:
                places[i] = known.setdefault(name, len(known))
        return places[which], None

    def text(self, row: int) -> str:
        """Say what stands in a cell."""
        return self.buffer[self.start[row] : self.end[row]].tobytes().decode()


def csv_tables(path: Path, schema: Schema, *, progress: Progress | None = None) -> Iterator[Table]:
    """Read a comma-separated file with a header, some rows at a time.

    Columns come in any order; empty lines are skipped; a quoted cell may hold commas but no line
    feed. `InputError` for a header that `schema` does not allow and for lines of another width.
    """
    header: list[str] = []
    for block in line_blocks(path, progress=progress):
        if not header:
            line, _, rest = block.data.partition(b"\n")
            header = _header(line.decode(), schema, path)
            block = Block(2, rest)
        columns = _columns(block.data, header)
        if columns is None:
            yield from _careful(block, header, path)
        else:
            count = columns[header[0]].start.size
            rows = np.arange(block.line, block.line + count, dtype=np.int64)
            yield Table(str(path), "line", rows, columns)
    if not header:
        raise InputError(f"{path}: found an empty file, expected {schema}")


def _header(line: str, schema: Schema, path: Path) -> list[str]:
    header = [column.strip() for column in next(csv.reader([line]), list[str]())]
    if len(header) == 1 and (";" in line or "\t" in line):
        raise InputError(f"{path}, line 1: found {line[:60]!r}, expected commas between columns")
    check_columns(header, schema, f"{path}, line 1")
    return header


def _columns(data: bytes, header: list[str]) -> Mapping[str, TextColumn] | None:
    """Cut a block into cells; None if this needs care.

    That is, if it has empty lines, lines of another width, or quotes that mean something.
    """
    if b'"' in data:
        if not _quotes_are_idle(data):
            return None
        data = data.replace(b'"', b"")
    buffer = np.frombuffer(data + _PAD, np.uint8)
    text = buffer[: len(data)]
    line_feed = text == ord("\n")
    ends = np.flatnonzero(line_feed | (text == ord(",")))
    lines, rest = divmod(ends.size, len(header))
    if rest or np.count_nonzero(line_feed) != lines:
        return None
    ends = ends.reshape(lines, len(header))
    if not line_feed[ends[:, -1]].all():
        return None
    starts = np.empty_like(ends)
    starts[:, 1:] = ends[:, :-1] + 1
    starts[1:, 0] = ends[:-1, -1] + 1
    starts[:1, 0] = 0
    return {
        column: TextColumn(buffer, starts[:, i].copy(), ends[:, i].copy())
        for i, column in enumerate(header)
    }


def _quotes_are_idle(data: bytes) -> bool:
    """Tell if all quotes stand round whole cells that hold no comma, line feed or quote."""
    text = np.frombuffer(b"\n" + data, np.uint8)
    quotes = np.flatnonzero(text == ord('"'))
    separator = (text == ord("\n")) | (text == ord(","))
    if quotes.size % 2 or not (separator[quotes[::2] - 1] & separator[quotes[1::2] + 1]).all():
        return False
    cell = np.searchsorted(np.flatnonzero(separator), quotes)
    return bool((cell[::2] == cell[1::2]).all())


def _careful(block: Block, header: list[str], path: Path) -> Iterator[Table]:
    """Read a block line by line; what stands before a fault is still handed on first."""
    rows: list[list[str]] = []
    numbers: list[int] = []
    problem = ""
    reader = csv.reader(block.data.decode().split("\n")[:-1], strict=True)
    line = block.line
    try:
        for row in reader:
            if block.line + reader.line_num - 1 != line:
                problem = "found a line feed in a quoted cell, expected one row a line"
            elif len(row) == len(header):
                rows.append(row)
                numbers.append(line)
            elif any(cell.strip() for cell in row) or len(row) > 1:
                problem = f"found {len(row)} cells, expected {len(header)}: {','.join(header)}"
            if problem:
                break
            line += 1
    except csv.Error as error:
        problem = f"found a cell that cannot be read ({error}), expected comma-separated values"
    if rows:
        lines = np.array(numbers, np.int64)
        yield Table(str(path), "line", lines, _packed(rows, header))
    if problem:
        raise InputError(f"{path}, line {line}: {problem}")


def _packed(rows: list[list[str]], header: list[str]) -> Mapping[str, Column]:
    """Put cells into one buffer again, without quotes and commas between them."""
    cells = [cell.encode() for row in rows for cell in row]
    buffer = np.frombuffer(b"".join(cells) + _PAD, np.uint8)
    lengths: NDArray[np.intp] = np.fromiter(map(len, cells), np.intp, len(cells))
    ends = np.cumsum(lengths).reshape(len(rows), len(header))
    starts = ends - lengths.reshape(ends.shape)
    return {
        column: TextColumn(buffer, starts[:, i].copy(), ends[:, i].copy())
        for i, column in enumerate(header)
    }

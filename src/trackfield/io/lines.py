"""Files of lines, read in blocks of whole lines so that memory does not grow with the file."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from trackfield.errors import InputError

Progress = Callable[[float], None]  # told the share of a file that has been read, 0 to 1

BLOCK_BYTES = 1 << 20


class Block(NamedTuple):
    """Whole lines of UTF-8 text, each with its line feed, and the number of the first one."""

    line: int
    data: bytes


def line_blocks(path: Path, *, progress: Progress | None = None) -> Iterator[Block]:
    """Read `path` in blocks of about `BLOCK_BYTES`; the mark of UTF-8 and CRs are taken off.

    `InputError` for a file that cannot be read, is not text in UTF-8, or has a line longer than a
    block.
    """
    line = 1
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            for data in _whole_lines(file, path):
                if line == 1:
                    data = data.removeprefix(b"\xef\xbb\xbf")
                _check_text(data, line, path)
                lines = data.count(b"\n")
                yield Block(line, data.replace(b"\r\n", b"\n") if b"\r" in data else data)
                line += lines
                if progress is not None and size:
                    progress(min(file.tell() / size, 1.0))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def _whole_lines(file: BinaryIO, path: Path) -> Iterator[bytes]:
    rest = b""
    while data := file.read(BLOCK_BYTES):
        cut = data.rfind(b"\n") + 1
        if cut:
            yield rest + data[:cut]
            rest = data[cut:]
        elif len(rest) + len(data) > BLOCK_BYTES:
            raise InputError(
                f"{path}: found a line of over {BLOCK_BYTES} bytes, expected short ones"
            )
        else:
            rest += data
    if rest:
        yield rest + b"\n"


def _check_text(data: bytes, line: int, path: Path) -> None:
    wrong = data.find(b"\0")
    try:
        data.decode()
    except UnicodeDecodeError as error:
        wrong = error.start if wrong < 0 else min(wrong, error.start)
    if wrong >= 0:
        at = line + data.count(b"\n", 0, wrong)
        raise InputError(f"{path}, line {at}: found binary data, expected text in UTF-8")

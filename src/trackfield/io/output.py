"""Files that get their name only when they are complete."""

from __future__ import annotations

import os
import secrets
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from trackfield.errors import InputError


@contextmanager
def replacing(path: Path) -> Generator[BinaryIO]:
    """Open a file for writing that becomes `path` when the block ends, and never if it fails.

    It is made beside `path` at once, so that a place that cannot be written is told before the
    work starts, with `InputError`. A pipe or a device has no beside: it is written directly.
    """
    target = Path(os.path.realpath(path))  # a link stays one
    with saying(path):
        before, regular = target.exists(), target.is_file()
        if target.is_dir():
            raise InputError(f"{path}: cannot be written: found a folder, expected a file")
    if before and not regular:
        with saying(path):
            file = target.open("wb")
        with _closed(file, path):
            yield file
        return
    draft = target.with_name(f".trackfield-{secrets.token_hex(8)}.tmp")
    with saying(path):
        if before:
            target.open("ab").close()  # may it be written at all?
        file = draft.open("xb")
    try:
        with _closed(file, path):
            yield file
        with saying(path):
            draft.replace(target)
    except BaseException:  # an interrupt too must leave nothing behind
        draft.unlink(missing_ok=True)
        raise


@contextmanager
def saying(path: Path) -> Generator[None]:
    """Turn trouble of the system inside the block into an `InputError` about `path`."""
    try:
        yield
    except FileNotFoundError:
        raise InputError(f"{path}: cannot be written: found no folder {path.parent}") from None
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{path}: cannot be written: {reason}") from error


@contextmanager
def _closed(file: BinaryIO, path: Path) -> Generator[None]:
    """Close a file, which may fail too; after a failure the first one is told, not the second."""
    try:
        yield
    except BaseException:
        with suppress(OSError):
            file.close()
        raise
    with saying(path):
        file.close()

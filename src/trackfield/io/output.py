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
    if _is_pipe(target, path):
        with saying(path):
            file = target.open("wb")
        with _closed(file, path):
            yield file
        return
    draft, file = _draft(target, path)
    try:
        with _closed(file, path):
            yield file
        with saying(path):
            draft.replace(target)
    except BaseException:  # an interrupt too must leave nothing behind
        draft.unlink(missing_ok=True)
        raise


def check_writable(path: Path) -> None:
    """Raise `InputError` now if a file could not be written to `path` later."""
    target = Path(os.path.realpath(path))
    if not _is_pipe(target, path):
        draft, file = _draft(target, path)
        file.close()
        draft.unlink()


def _is_pipe(target: Path, path: Path) -> bool:
    """Tell if `target` is there and no regular file; `InputError` for a folder."""
    with saying(path):
        if target.is_dir():
            raise InputError(f"{path}: cannot be written: found a folder, expected a file")
        return target.exists() and not target.is_file()


def _draft(target: Path, path: Path) -> tuple[Path, BinaryIO]:
    """Open a new file beside `target`; `InputError` about `path` where that cannot be."""
    draft = target.with_name(f".trackfield-{secrets.token_hex(8)}.tmp")
    with saying(path):
        if target.exists():
            target.open("ab").close()  # may it be written at all?
        return draft, draft.open("xb")


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

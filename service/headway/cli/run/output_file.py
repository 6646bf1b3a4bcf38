"""A file that appears whole or not at all."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from headway.errors import UserError


@contextmanager
def replaced(path: Path) -> Iterator[IO[bytes]]:
    """Write beside `path` and put the file into its place at the end; after an error nothing is left.

    Raises
    ------
    UserError
        It cannot be written.
    """
    part = path if path.exists() and not path.is_file() else path.with_name(f"{path.name}.part")
    try:
        file = part.open("wb")
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from None
    try:
        with file:
            yield file
        if part != path:
            part.replace(path)
    except BaseException as error:
        if part != path:
            part.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename is None:
            raise UserError(f"{path}: {error.strerror}") from None
        raise

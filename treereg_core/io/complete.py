"""Files that are complete or absent."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from treereg_core.errors import InputError
from treereg_core.io.files import reason
from treereg_core.io.lock import NoLocks, hold
from treereg_core.io.staging import PREFIX


@contextmanager
def complete_file(path: Path) -> Iterator[IO[bytes]]:
    """A file to write that takes its name only when it is complete; nothing is left behind otherwise."""
    try:
        descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=PREFIX)
    except OSError as error:
        raise InputError(f"{path} cannot be written ({reason(error)}); choose another place.") from error
    try:
        with os.fdopen(descriptor, "wb") as file:
            with suppress(NoLocks):  # held, it is known not to be left over
                hold(descriptor)
            yield file
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
    except BaseException as error:
        Path(temporary).unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise InputError(f"{path} cannot be written ({reason(error)}); choose another place.") from error
        raise


def _umask() -> int:
    """The process's mask of permissions; a temporary file is private, a finished one should be as any other."""
    mask = os.umask(0)
    os.umask(mask)
    return mask

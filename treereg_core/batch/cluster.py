"""A Dask cluster as the workers of a batch."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

from treereg_core.batch.order import Limits
from treereg_core.batch.running import Workers, guarded_here
from treereg_core.errors import UsageError
from treereg_core.registry import installed

CONNECT_S = 10.0
"""How long a scheduler may take to answer, and to have a worker, seconds."""


@contextmanager
def cluster(address: str, plugins: Mapping[str, str], folder: Path, limits: Limits) -> Iterator[Workers]:
    """The workers of the Dask scheduler at this address, and those that join it later.

    `folder` is that of the batch, which every worker must see; `plugins` are the distributions of the methods, which
    must be the same everywhere. `UsageError` when they are not, when nothing answers or when there is no worker.
    """
    try:
        import distributed
    except ImportError:
        raise UsageError("--scheduler needs Dask; install it with `pip install treereg[dask]`.") from None
    try:
        client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UsageError(f"--scheduler {address}: no Dask scheduler answers there; start one, or mend it.") from error
    executor = client.get_executor()
    try:
        check_workers(client, address, (dict(plugins), metadata.version("treereg")), folder.absolute())
        yield Workers(executor, partial(guarded_here, limits), lambda: sum(client.nthreads().values()))
    finally:
        executor.shutdown(wait=False)
        client.close()


def check_workers(client: Any, address: str, wanted: tuple[dict[str, str], str], folder: Path) -> None:
    """Refuse a cluster without workers, or with one that has other methods or does not see the folder."""
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError:
        raise UsageError(f"--scheduler {address} has no workers; start some with `dask worker {address}`.") from None
    for worker, found in client.run(about, sorted(wanted[0]), folder, on_error="return").items():
        if isinstance(found, BaseException):
            text = " ".join(str(found).split()) or type(found).__name__
            raise UsageError(f"the Dask worker {worker} cannot run treereg ({text:.200}); install it there.")
        plugins, version, sees = found
        if (plugins, version) != wanted:
            raise UsageError(
                f"the Dask worker {worker} has treereg {version} with {_in_words(plugins)}, where treereg {wanted[1]} "
                f"with {_in_words(wanted[0])} is here; install the same."
            )
        if not sees:
            raise UsageError(
                f"the Dask worker {worker} does not see {folder}; choose a folder that all machines share."
            )


def about(names: list[str], folder: Path) -> tuple[dict[str, str], str, bool]:
    """What a worker says of itself: who offers these methods, its treereg, and whether it sees the folder."""
    origins = {entry.name: entry.origin for entry in installed().entries if entry.name in names}
    return origins, metadata.version("treereg"), folder.is_dir()


def _in_words(plugins: Mapping[str, str]) -> str:
    return ", ".join(plugins.values()) or "no methods"

"""Calls carried out in processes of their own, so that one that crashes or hangs takes no other along."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from types import TracebackType
from typing import Any, TypeVar

T = TypeVar("T")
Progress = Callable[[int, int], None]
"""Takes how many of how many calls have come to an end; first of all none of them."""
LEAVE_S = 1.0
"""How long a process that closed its pipe may take to end, seconds."""


class ProcessDied(Exception):  # noqa: N818 -- an outcome, not a fault of ours
    """The process of a call ended before it answered; the text says how."""


class TimeUp(Exception):  # noqa: N818 -- an outcome, not a fault of ours
    """A call took longer than it may, and its process was ended."""


class Closed(Exception):  # noqa: N818 -- an outcome, not a fault of ours
    """The processes were closed before a call was answered: nobody wants to know any more."""


class Processes:
    """Spawned processes of one thread each, for use in a `with` statement; any thread may call.

    There are as many as calls at one time; each is used again, and replaced when it dies. `memory_bytes` is the most
    that each may allocate, where the system has such a limit; beyond it a call raises `MemoryError`.
    """

    def __init__(self, memory_bytes: int | None = None) -> None:
        self._memory_bytes = memory_bytes
        self._lock = threading.Lock()
        self._all: set[_Child] = set()
        self._idle: list[_Child] = []
        self._closed = False

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: object, trace: TracebackType | None) -> None:
        self.close()

    def call(self, function: Callable[..., T], arguments: tuple[Any, ...] = (), seconds: float | None = None) -> T:
        """What `function(*arguments)` gives or raises in another process.

        Raises `TimeUp` after so many seconds, `ProcessDied` when the process dies, and `Closed` when these are closed.
        """
        with self._lock:
            if self._closed:
                raise Closed
            child = self._idle.pop() if self._idle else None
        child = child or _Child(self._memory_bytes)
        with self._lock:
            self._all.add(child)
            if self._closed:
                child.end()
        try:
            good, value = child.ask(function, arguments, seconds)
        except BaseException as error:
            child.end()
            child.wait()  # what it held is free then
            with self._lock:
                self._all.discard(child)
                closed = self._closed
            if closed and isinstance(error, ProcessDied):
                raise Closed from error
            raise
        with self._lock:
            self._idle.append(child)
        if good:
            return value  # type: ignore[no-any-return]
        raise value

    def close(self) -> None:
        """End all processes at once; calls that are under way raise `Closed`."""
        with self._lock:
            self._closed = True
            for child in self._all:
                child.end()


class _Child:
    """One process and the pipe to it."""

    def __init__(self, memory_bytes: int | None) -> None:
        # Spawned processes import numpy afresh, so that it meets these settings.
        os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
        # The processes of a Dask worker are daemons, which may have no children unless they say they are none.
        with suppress(AssertionError):
            multiprocessing.current_process().daemon = False
        context = multiprocessing.get_context("spawn")
        self._pipe, its = context.Pipe()
        self._process = context.Process(target=_serve, args=(its, memory_bytes), daemon=True)
        with _interruptions_held():
            self._process.start()
        its.close()

    def ask(self, function: Callable[..., Any], arguments: tuple[Any, ...], seconds: float | None) -> tuple[bool, Any]:
        """Whether the call went well, and what it gave or raised."""
        try:
            self._pipe.send((function, arguments))
            answer: tuple[bool, Any] | None = self._pipe.recv()
            if answer is None:  # begun: a new process takes a while to start, which is no fault of the call
                if not self._pipe.poll(seconds):
                    raise TimeUp(f"it took longer than {seconds:g} s")
                answer = self._pipe.recv()
                assert answer is not None
        except (EOFError, OSError) as error:
            self._process.join(LEAVE_S)
            self.end()
            self.wait()
            raise ProcessDied(_how(self._process.exitcode)) from error
        return answer

    def end(self) -> None:
        """End it at once."""
        self._process.kill()

    def wait(self) -> None:
        """Wait until it has ended."""
        self._process.join()


@contextmanager
def _interruptions_held() -> Iterator[None]:
    """Nothing that is started meanwhile is told of Ctrl-C, which a terminal sends to all processes."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # The first process of all would start it too, which lets interruptions through again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(pipe: Connection, memory_bytes: int | None) -> None:
    """What a process does all its life: answer calls, until there is nobody to ask."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(OSError, ValueError):  # what a method prints is no result
        os.dup2(sys.__stderr__.fileno(), 1)  # type: ignore[union-attr]
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    if memory_bytes:
        _limit_memory(memory_bytes)
    while True:
        try:
            sent = pipe.recv_bytes()
        except EOFError:
            return
        try:
            function, arguments = pickle.loads(sent)
            pipe.send(None)
            answer = True, function(*arguments)
        except Exception as error:
            error.add_note("".join(traceback.format_exception(error)))
            answer = False, error
        try:
            pipe.send(answer)
        except OSError:
            return
        except Exception as error:  # what cannot be pickled
            pipe.send((False, RuntimeError(f"{type(error).__name__}: {error}")))


def _leave_with_parent() -> None:
    """A process whose parent was killed must not go on alone."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)


def _limit_memory(size: int) -> None:
    with suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (size, size))


def _how(code: int | None) -> str:
    """How a process ended, in words."""
    if code is not None and code < 0:
        name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
        likely = "; most likely memory ran out" if name == "SIGKILL" else ""
        return f"its process was killed ({name}{likely})"
    return f"its process ended by itself (exit code {code})"


def spread(
    call: Callable[..., T],
    tasks: Sequence[tuple[Any, ...]],
    jobs: int,
    progress: Progress,
    guard: Callable[..., T] = Processes.call,
) -> Iterator[T]:
    """`call(*task)` for each task, in the order in which they finish.

    `guard(processes, call, task)` makes the call, and may give another result when its process dies; by default that
    raises `ProcessDied`.
    """
    with Processes() as processes, ThreadPoolExecutor(jobs) as pool:
        futures = [pool.submit(guard, processes, call, task) for task in tasks]
        try:
            progress(0, len(tasks))
            for k, future in enumerate(as_completed(futures), 1):
                yield future.result()
                progress(k, len(tasks))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            processes.close()
            raise

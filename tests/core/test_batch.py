"""The parts of a batch: manifests, the window of orders, what to look at first, processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from treereg_core.batch import Order, Outcome, Word, Work, Workers, read_manifest, run_batch
from treereg_core.batch.attention import first_to_look_at
from treereg_core.batch.files import summary_csv
from treereg_core.errors import InputError
from treereg_core.options import Options
from treereg_core.processes import Closed, ProcessDied, Processes, TimeUp, spread

HEADER = "orchard,reference,source\n"
WORK = Work(Options(), {})


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "line 1: there is no column 'orchard'"),
        ("\n\n", "line 1: there is no column 'orchard'"),
        ("orchard,reference\na,b\n", "line 1: there is no column 'source'"),
        ("orchard,orchard,reference,source\n", "two columns 'orchard'"),
        (HEADER, "names no orchard"),
        (HEADER + "a,b,c\na,d,e\n", "line 3: the orchard 'a' is in line 2 already"),
        (HEADER + "a,b,c\n\nA,d,e\n", "line 4: the orchard 'A' is in line 2 already"),
        (HEADER + "../x,b,c\n", "line 2: the orchard '../x' has one of"),
        (HEADER + "..,b,c\n", "begins or ends with a dot"),
        (HEADER + "=1+1,b,c\n", "begins with =, which spreadsheets take for a formula"),
        (HEADER + "-out,b,c\n", "begins with -"),
        (HEADER + "C:\\x,b,c\n", "has one of"),
        (HEADER + "a\x1b[2J,b,c\n", "cannot be shown"),
        (HEADER + "a" * 101 + ",b,c\n", "longer than 100"),
        (HEADER + "Summary.csv,b,c\n", "name of a file of the results"),
        (HEADER + "a,b\n", "line 2 has 2 cells, where the first line has 3"),
        (HEADER + "a,b,c,d\n", "line 2 has 4 cells"),
        (HEADER + "a,,c\n", "line 2 has no reference"),
        (HEADER + " ,b,c\n", "line 2 has no orchard"),
        (HEADER + 'a,b,c\nb,"c,d\n', "is not CSV"),
        ((HEADER + "é,b,c\n").encode("latin-1"), "line 2 is not text in UTF-8"),
        ((HEADER + "a,b,c\n").encode("utf-16"), "line 1 is not text in UTF-8"),
        (b"\x00\x00\x00", "there is no column"),
    ],
)
def test_a_bad_manifest_is_refused_in_one_sentence(content: str | bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "manifest.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError) as caught:
        read_manifest(path)
    assert words in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "content",
    [
        HEADER + "north,a/b,../c\n",
        "\ufeff" + HEADER + "north,a/b,../c\n",
        "orchard;reference;source\r\nnorth;a/b;../c\r\n",
        "orchard\treference\tsource\nnorth\ta/b\t../c",
        'note,source,orchard,reference\n"one, two","../c",north, a/b \n,,,\n',
    ],
)
def test_a_manifest_as_spreadsheets_write_it(content: str, tmp_path: Path) -> None:
    path = tmp_path / "manifest.csv"
    path.write_bytes(content.encode())
    (row,) = read_manifest(path)
    assert (row.orchard, row.reference, row.source) == ("north", tmp_path / "a" / "b", tmp_path.parent / "c")


class Counting(ThreadPoolExecutor):
    """Counts the most calls that were under way at one time."""

    def __init__(self, workers: int) -> None:
        super().__init__(workers)
        self._now, self.most, self._counter = 0, 0, threading.Lock()

    def submit(self, *arguments: Any, **named: Any) -> Future[Any]:
        with self._counter:
            self._now += 1
            self.most = max(self.most, self._now)
        future = super().submit(*arguments, **named)
        future.add_done_callback(self._finished)
        return future

    def _finished(self, future: Future[Any]) -> None:
        with self._counter:
            self._now -= 1


def orders(count: int) -> list[Order]:
    return [Order(f"o{k}", Path("a"), Path("b"), Path("out") / f"o{k}", WORK) for k in range(count)]


def finished(order: Order) -> Outcome:
    if order.orchard == "o500":
        raise RuntimeError("the worker\nis lost")
    return Outcome(order.orchard, Word.ACCEPTED, "fine")


def test_thousands_are_queued_by_a_window() -> None:
    with Counting(4) as executor:
        found = list(run_batch(orders(2000), Workers(executor, finished, lambda: 4)))
        assert executor.most <= 8
    assert {outcome.orchard for outcome in found} == {f"o{k}" for k in range(2000)}
    (lost,) = [outcome for outcome in found if outcome.verdict is not Word.ACCEPTED]
    assert (lost.orchard, lost.verdict) == ("o500", Word.CRASHED)
    assert "the worker is lost" in lost.reason


def test_what_to_look_at_first() -> None:
    usual = [
        Outcome(f"o{k}", Word.ACCEPTED, "", 0.015 + 0.0001 * k, 1e-6, 90, 0.9 - 0.001 * k, 0.3, 2.0 + 0.1 * k, 0.1)
        for k in range(20)
    ]
    assert first_to_look_at(usual) == []
    odd = [
        replace(usual[0], orchard="few", share=0.6),
        replace(usual[1], orchard="vague", expected_error=0.2, share=0.5),
        replace(usual[2], orchard="better", share=0.99, expected_error=0.001),
    ]
    bad = [Outcome(word.value, word, word.value) for word in Word if word is not Word.ACCEPTED]
    found = first_to_look_at([*usual, *odd, *bad])
    assert [outcome.orchard for outcome, _ in found] == [
        *("crashed", "memory", "timeout", "unusable", "failed", "ambiguous", "vague", "few"),
    ]
    assert [why for _, why in found[-2:]] == [
        "a high expected error (0.200 m); few trees matched (50%)",
        "few trees matched (60%)",
    ]
    assert first_to_look_at(usual[:8]) == []


def test_the_summary_survives_odd_names() -> None:
    order = Order('a, "b"', Path("x,y"), Path("b"), Path("out"), WORK)
    text = summary_csv([order], [Outcome(order.orchard, Word.FAILED, "one,\ntwo", warnings=("w",))])
    assert text.splitlines()[1].startswith('"a, ""b""",failed,"one,')


def test_an_outcome_comes_back_from_json() -> None:
    outcome = Outcome("o", Word.AMBIGUOUS, "why", 0.1, 0.2, 3, 0.5, None, 1.0, -2.0, 3.5, 2, ("a", "b"))
    assert Outcome.from_json(outcome.to_json()) == outcome


def test_a_process_is_used_again_until_it_dies() -> None:
    with Processes() as processes:
        first = processes.call(os.getpid)
        assert processes.call(os.getpid) == first != os.getpid()
        with pytest.raises(ZeroDivisionError):
            processes.call(divmod, (1, 0))
        assert processes.call(os.getpid) == first
        with pytest.raises(ProcessDied, match="exit code 7"):
            processes.call(os._exit, (7,))
        second = processes.call(os.getpid)
        os.kill(second, signal.SIGKILL)
        with pytest.raises(ProcessDied, match="SIGKILL"):
            processes.call(os.getpid)
        with pytest.raises(TimeUp):
            processes.call(signal.pause, (), 0.5)
        assert processes.call(os.getpid) not in (first, second)
        # what cannot be pickled is an error, and the process lives
        with pytest.raises(RuntimeError, match="pickle"):
            processes.call(threading.Lock)
        with pytest.raises(AttributeError):
            processes.call(lambda: 0)
        assert processes.call(abs, (-1,)) == 1
    with pytest.raises(Closed):
        processes.call(os.getpid)


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="needs signal masks")
def test_not_even_the_first_process_is_told_of_an_interruption_while_it_starts() -> None:
    code = (
        "import signal; from treereg_core.processes import Processes\n"
        "with Processes() as p: print(signal.SIGINT in p.call(signal.pthread_sigmask, (signal.SIG_BLOCK, ())))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"


def test_closing_ends_a_call_under_way() -> None:
    processes = Processes()
    threading.Timer(1.0, processes.close).start()
    with pytest.raises(Closed):
        processes.call(signal.pause)


def test_spread_gives_all_results_or_the_error() -> None:
    said: list[tuple[int, int]] = []
    tasks = [(k, 2) for k in range(20)]
    assert sorted(spread(pow, tasks, 2, lambda *counted: said.append(counted))) == [k * k for k in range(20)]
    assert said == [(k, 20) for k in range(21)]
    with pytest.raises(ProcessDied):
        list(spread(os._exit, [(3,)] * 3, 2, lambda *counted: None))

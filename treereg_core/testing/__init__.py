"""The contract as something to run: laws, scenes and strategies for methods of one's own::

    from treereg_core.testing import check
    for result in check(MyMatcher()):
        print(result)

`laws_for(method)` gives the laws one by one, for a parametrised test; `treereg check FILE.py` does the same from the
command line. `treereg_core.testing.scenes` has small simulated surveys with their truth. Neither needs pytest or
hypothesis; `treereg_core.testing.strategies` needs hypothesis.
"""

from __future__ import annotations

from collections.abc import Iterator

from treereg_core.method import Method
from treereg_core.testing.law import Law, LawResult, LawSkipped
from treereg_core.testing.laws import laws_for

__all__ = ["Law", "LawResult", "LawSkipped", "check", "laws_for"]


def check(method: Method) -> Iterator[LawResult]:
    """Try every law that applies to a method, one after the other; a broken one is a result, not an error."""
    for law in laws_for(method):
        name = law.__name__.replace("_", " ")
        try:
            law(method)
        except LawSkipped as reason:
            yield LawResult(name, passed=True, skipped=True, message=str(reason))
        except AssertionError as broken:
            yield LawResult(name, passed=False, message=str(broken).partition(": ")[2])
        else:
            yield LawResult(name, passed=True)

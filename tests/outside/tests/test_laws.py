"""The laws of treereg's contract on every method of this plugin."""

import pytest
from treereg_outside import LargeCrowns, Mutual, StraightRows

from treereg_core.testing import laws_for

CASES = [(law, method) for method in (LargeCrowns(), StraightRows(), Mutual()) for law in laws_for(method)]


@pytest.mark.parametrize(("law", "method"), CASES, ids=[f"{method.name} {law.__name__}" for law, method in CASES])
def test_law(law, method):
    law(method)

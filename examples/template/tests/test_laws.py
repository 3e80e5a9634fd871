"""The laws of treereg's contract."""

import pytest
from treereg_template import Template

from treereg_core.testing import laws_for


@pytest.mark.parametrize("law", laws_for(Template()), ids=lambda law: law.__name__)
def test_law(law):
    law(Template())

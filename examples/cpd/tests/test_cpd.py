"""The laws of treereg's contract, and what is particular to coherent point drift."""

import numpy as np
import pytest
from treereg_cpd import Cpd

from treereg_core.errors import NoRegistration
from treereg_core.method import Context
from treereg_core.pair import Pair
from treereg_core.testing import laws_for
from treereg_core.testing.scenes import near, ordinary, scene


@pytest.mark.parametrize("law", laws_for(Cpd()), ids=lambda law: law.__name__)
def test_law(law):
    law(Cpd())


def test_what_has_not_settled_is_refused():
    with pytest.raises(NoRegistration, match="not settled after 2 rounds"):
        Cpd(rounds=2).register(near(ordinary()), Context())


def test_too_many_trees_are_refused_before_any_work():
    with pytest.raises(NoRegistration, match=r"more than the 100 of cpd\.most_trees"):
        Cpd(most_trees=100).register(near(ordinary()), Context())


def test_the_size_stays_as_it_is():
    pair = near(ordinary())
    centre = pair.source.xy.mean(axis=0)
    grown = pair.source.replace(xy=centre + 1.005 * (pair.source.xy - centre))
    result = Cpd().register(Pair(pair.reference, grown, pair.reference_from_source), Context())
    assert np.linalg.det(result.transform.linear) == pytest.approx(1, abs=1e-12)


def test_a_survey_of_which_half_has_no_partner_needs_strangers():
    simulation = scene("half overlap")
    assert simulation.error(Cpd().register(near(simulation), Context()).transform) < 0.1
    with pytest.raises(NoRegistration, match="not settled"):
        Cpd(outliers=0).register(near(simulation), Context())

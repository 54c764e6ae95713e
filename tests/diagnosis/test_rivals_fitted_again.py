"""How far a rival may be fitted again before it imitates what was found."""

import pytest
from pytest import approx
from test_next_manoeuvre import NOTHING, judged, stand
from trials import SHIP

from manoeuvre_nn.diagnosis.advise import apart
from manoeuvre_nn.effect.rudder import RudderOffset

pytestmark = pytest.mark.usefixtures("unchecked_types")


def test_a_rival_of_the_same_kind_makes_up_for_an_effect_within_three_standard_deviations_of_its_prior():
    """Of information ``I`` on it: ``1/2 x^2 I / (1 + 9 I sd^2)``."""
    place, offset, none = stand("zigzag"), RudderOffset(SHIP, offset_deg=0.01), RudderOffset(SHIP, offset_deg=0.0)
    rival = judged(none).hypothesis
    (sd,) = rival.prior_sds()
    alone = apart(place, judged(offset).hypothesis, NOTHING.hypothesis, (0, 1))
    information = 2 * alone / 0.01**2
    left = apart(place, judged(offset).hypothesis, rival, (0, 1))
    assert left == approx(alone / (1 + 9 * information * sd**2), rel=0.02)

"""What speaks for or against a join, in one value."""

from __future__ import annotations

from shared.ropes import R
from strand.config import Linking
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.reconstruction.evidence.prior import Prior


def test_what_is_known_of_all_ropes_is_not_known_of_one_class_of_radius():
    evidence = JoinEvidence(R, Linking(), prior=Prior.from_caller(2, [0.3, 0.4]))
    alone = evidence.select_class(0.006, 1)
    assert (alone.radius, alone.prior) == (0.006, evidence.prior)
    one = evidence.select_class(0.006, 2)
    assert (one.radius, one.prior.ropes, one.prior.lengths) == (0.006, None, ())
    assert one.config is evidence.config
    alike = JoinEvidence(R, Linking(), prior=Prior.from_caller(2, 0.3)).select_class(R, 2)
    assert (alike.prior.ropes, alike.prior.lengths) == (None, (0.3,))

"""Counts of right orders: crossings of chains beside the true ones."""

from __future__ import annotations

import numpy as np
import pytest

import order
from shared.ropes import R
from strand import Chain, Model
from strand.synthetic import random_ropes

ROPES = random_ropes(4, 2, R, 2)


def list_found(chains):
    return order.compare_crossings(chains, Model(chains, np.eye(4)[None]).crossings(), ROPES, R)


def test_the_truth_is_right_whichever_way_its_chains_run():
    chains = tuple(Chain(nodes, R) for nodes in ROPES)
    for given in (chains, chains[::-1], tuple(chain.reversed() for chain in chains)):
        said = list_found(given)
        assert sorted(one.true for one in said) == list(range(len(order.find_true_crossings(ROPES, R)[1])))
        assert all(one.right for one in said)


def test_ropes_upside_down_are_the_other_way_round():
    said = list_found(tuple(Chain(nodes * [1, 1, -1], R) for nodes in ROPES))
    assert None not in {one.true for one in said}
    assert not any(one.right for one in said)


def test_a_crossing_where_there_is_none_is_wrong():
    beyond = np.max([nodes.max(axis=0) for nodes in ROPES], axis=0) + 20 * R
    step = 3 * R * np.array([[1, 1, 0], [1, -1, 0]])
    (only,) = list_found(tuple(Chain([beyond - way, beyond + way], R) for way in step))
    assert (only.true, only.right) == (None, False)


def test_shares_and_counts():
    crossings = [{"probability": 0.999, "true": k, "right": k < 9} for k in range(10)]
    record = {"noise": 0.15, "right": True, "true": 10, "crossings": crossings}
    ((low, high, count, said, right),) = order.group_by_probability([record])
    assert (low, high, count) == (0.995, 1.0, 10)
    assert (said, right) == pytest.approx((0.999, 0.9))
    assert order.group_by_noise([record, {**record, "right": False}]) == [
        ("all", 2, 1, 10, 9, 1),
        ("0.1-0.2", 2, 1, 10, 9, 1),
    ]

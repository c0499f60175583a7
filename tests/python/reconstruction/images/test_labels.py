"""Changes of a mask's labels along ropes."""

from __future__ import annotations

import numpy as np

from strand.reconstruction.images.labels import count_label_changes


def straight(row, start=0, stop=100):
    columns = np.arange(start, stop, 2.0)
    return np.column_stack([columns, np.full(len(columns), float(row))])


def test_changes_of_labels_count_but_for_short_ones_and_what_is_no_rope():
    labels = np.zeros((60, 100), dtype=np.int32)
    labels[20:30] = 1
    labels[40:50] = 2
    assert count_label_changes(labels, [straight(25), straight(45)]) == 0
    # an upper strand's label is seen where it crosses; outside of masks and images there is none
    labels[20:30, 30:42] = 2
    labels[20:30, 60:80] = 0
    assert count_label_changes(labels, [straight(25, -20, 140)]) == 0
    labels[20:30, 50:] = 3
    assert count_label_changes(labels, [straight(25)]) == 1
    # ropes that swap
    swapped = np.vstack([straight(25)[:20], straight(45)[20:]])
    assert count_label_changes(labels, [straight(5), swapped]) == 1
    assert count_label_changes(labels, []) == 0

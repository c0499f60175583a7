"""Ropes that branch, as a graph: map, lines, places, strands, the joint fit, the answer."""

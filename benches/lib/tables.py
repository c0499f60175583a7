"""Markdown tables, a line at a time: a row can be printed as soon as it is measured."""

from __future__ import annotations


def head(*titles: str) -> str:
    """The two lines above a table's rows."""
    return f"{row(*titles)}\n|{'---|' * len(titles)}"


def row(*cells: object) -> str:
    """One line of a table."""
    return f"| {' | '.join(map(str, cells))} |"

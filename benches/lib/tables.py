"""Markdown tables, printed a line at a time: a row appears as soon as it is measured."""

from __future__ import annotations


def format_head(*titles: str) -> str:
    """Return the two lines above a table's rows."""
    return f"{format_row(*titles)}\n|{'---|' * len(titles)}"


def format_row(*cells: object) -> str:
    """Return one line of a table."""
    return f"| {' | '.join(map(str, cells))} |"


def print_head(*titles: str) -> None:
    """Print the two lines above a table's rows."""
    print(format_head(*titles), flush=True)


def print_row(*cells: object) -> None:
    """Print one line of a table."""
    print(format_row(*cells), flush=True)

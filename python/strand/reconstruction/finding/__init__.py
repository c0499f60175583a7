"""Ropes found among other things on a table."""

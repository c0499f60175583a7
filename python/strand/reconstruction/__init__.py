"""From views to ropes."""

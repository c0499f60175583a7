"""Describe a reconstruction in tables, figures, an HTML page and recordings for Rerun."""

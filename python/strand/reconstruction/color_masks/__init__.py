"""Masks of ropes from colour."""

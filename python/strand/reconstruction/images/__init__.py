"""Ropes read from images: the mask says how they may run, depth decides what it can."""

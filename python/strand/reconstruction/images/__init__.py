"""Ropes read from images: masks limit their courses, and depth chooses among these."""

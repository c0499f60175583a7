"""Checks of arguments, files, extras and lazy properties."""

"""Checks of arguments, files read and written safely, optional packages, and lazy properties."""

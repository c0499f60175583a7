"""Checks of arguments, files, extras, lazy properties and robust deviations."""

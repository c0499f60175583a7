"""Recorded scenes and saved models, read from files."""

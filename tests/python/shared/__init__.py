"""Ropes, files, recordings, calls of kernels and a browser for several tests."""

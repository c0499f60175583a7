"""Reconstructed ropes, and the questions that planners ask of them."""

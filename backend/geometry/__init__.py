"""Strands, frames, heads and the scalp space."""

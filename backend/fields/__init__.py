"""Grids of directions and the tracing of strands through them."""

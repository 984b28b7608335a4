"""Strands as elastic rods: helices, super-helix dynamics, contact, rest shape (Bao & Qi 2017, sec. V-VI)."""

"""Strands as elastic rods: piecewise helices, super-helix dynamics, contact and rest shape (Bao & Qi 2017, sec. V-VI)."""

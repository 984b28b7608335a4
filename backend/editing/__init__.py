"""Editing a finished groom: the comb that keeps the detail, and the flow that carries it (Wang et al. 2009, sec. 6)."""

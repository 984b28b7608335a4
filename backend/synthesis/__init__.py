"""Example-based synthesis of hairstyles (Wang et al. 2009)."""

"""Files in and out: one module per format, chosen by suffix in `strands.py`."""

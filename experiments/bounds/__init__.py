"""Proven lower bounds of the peak cost: the search for them, and in `verification` their independent check."""

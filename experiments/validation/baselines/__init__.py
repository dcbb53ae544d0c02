"""What else one could do about a mismatch: SINDy, a NARX network, ridge regression."""

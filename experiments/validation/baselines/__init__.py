"""Baselines for the treatment of a mismatch: SINDy, a NARX network, ridge regression."""

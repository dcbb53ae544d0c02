"""Localisation of the mismatch: in which recordings, when, at which frequency and drive."""

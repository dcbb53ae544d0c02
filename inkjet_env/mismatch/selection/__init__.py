"""Hypotheses about what was left out: scored, cross-validated, chosen."""

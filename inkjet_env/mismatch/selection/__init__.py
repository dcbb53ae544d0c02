"""Hypotheses about missing effects: scored, cross-validated, selected."""

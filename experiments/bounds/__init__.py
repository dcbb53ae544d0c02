"""Bounds of the cost from below."""

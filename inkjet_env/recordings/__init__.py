"""Recordings of a head: read, checked, written."""

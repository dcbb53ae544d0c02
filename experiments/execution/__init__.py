"""Execution of work on processes or a cluster, and its provenance: code and packages on which numbers depend."""

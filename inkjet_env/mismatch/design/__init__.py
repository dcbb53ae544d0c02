"""The design of the next experiment."""

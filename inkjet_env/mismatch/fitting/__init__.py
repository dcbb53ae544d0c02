"""Base model and effects fitted together to recordings, by output error."""

"""Stored data of the suite: best known waveforms, tuned settings, heads with effects."""

from importlib import resources
from pathlib import Path


def data_file(name: str) -> Path:
    """Path of a data file."""
    return Path(str(resources.files(__name__) / name))

"""Where the packages of this project are installed."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path


def _folder(package: str) -> Path:
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(
            f"{package} is not installed: its folder is missing. Run: pip install -e .", name=package
        )
    return Path(spec.origin).resolve().parent


PACKAGES = {
    name.rpartition(".")[2]: _folder(name) for name in ("inkjet_env", "inkjet_env.optimizers", "inkjet_env.experiments")
}
"""Folder of each package, by the name of its folder in the repository."""

"""What numbers depend on besides their settings: versions of packages, and the code itself."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from inkjet_env.installation import PACKAGES

DECISIVE_PACKAGES = (
    "inkjet-env",
    "numpy",
    "scipy",
    "numba",
    "cma",
    "nevergrad",
    "pymoo",
    "optuna",
    "torch",
    "stable-baselines3",
)


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that determine the numbers."""
    found = {"python": ".".join(str(part) for part in sys.version_info[:3])}
    for package in DECISIVE_PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def code_digest(patterns: Iterable[str]) -> str:
    """SHA-256, in hexadecimal, over the source files that match any of the patterns.

    Parameters
    ----------
    patterns : iterable of str
        Glob patterns that begin with a package's folder in the repository; installed files have the same digest.

    Raises
    ------
    ValueError
        A pattern matches no file: the files it was meant for would silently be missing from the digest.
    """
    found: dict[str, Path] = {}
    for pattern in patterns:
        folder, _, inner = pattern.partition("/")
        matching = {
            f"{folder}/{file.relative_to(PACKAGES[folder]).as_posix()}": file
            for file in PACKAGES[folder].glob(inner)
            if file.is_file() and _owner(file) == folder
        }
        if not matching:
            raise ValueError(
                f"code_digest: the pattern {pattern!r} matches no file in {PACKAGES[folder]}. "
                "Correct the pattern if a file was moved or renamed."
            )
        found |= matching
    total = sha256()
    for name, file in sorted(found.items(), key=lambda item: item[0].split("/")):
        total.update(f"{name}\0{sha256(file.read_bytes()).hexdigest()}\0".encode())
    return total.hexdigest()


def _owner(file: Path) -> str:
    """Which package a file belongs to; once installed, two of them lie within the third."""
    return max((name for name in PACKAGES if file.is_relative_to(PACKAGES[name])), key=lambda n: len(PACKAGES[n].parts))


def first_difference(stored: Any, asked: Any, place: str = "") -> str:
    """The first difference between two JSON values, in words; empty if they agree."""
    if isinstance(stored, dict) and isinstance(asked, dict):
        for name in [*asked, *(name for name in stored if name not in asked)]:
            inner = f"{place} {name}".strip()
            if name not in stored or name not in asked:
                return f"{inner} is {'new' if name in asked else 'missing'} here"
            if difference := first_difference(stored[name], asked[name], inner):
                return difference
        return ""
    return "" if stored == asked else f"{place} is {_brief(stored)} there and {_brief(asked)} here"


def _brief(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)

"""A campaign's folder as one value: its digest, its bytes for a worker without a shared disk, its permitted content."""

from __future__ import annotations

import io
import json
import zipfile
from hashlib import sha256
from pathlib import Path
from typing import Any

DESCRIPTOR = "datapackage.json"
TELLING = frozenset({"truth", "effect", "effects", "family", "strength", "rho", "variant", "concealed", "seed"})
"""Keys that a campaign's descriptor must not contain, because they may reveal the truth."""


class ProofError(ValueError):
    """A violation that would invalidate a proof: the run stops with this error."""


def digest(folder: Path) -> str:
    """SHA-256 over the names and contents of a campaign's files, in hexadecimal."""
    total = sha256()
    for file in _files(folder):
        content = file.read_bytes()
        total.update(f"{file.name}\0{len(content)}\0".encode())
        total.update(content)
    return total.hexdigest()


def pack(folder: Path) -> bytes:
    """A campaign's files as a ``.zip``."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=3) as archive:
        for file in _files(folder):
            archive.writestr(zipfile.ZipInfo(file.name), file.read_bytes(), zipfile.ZIP_DEFLATED)
    return buffer.getvalue()


def unpack(packed: bytes, folder: Path) -> None:
    """Write the files of `pack` into a new folder.

    Raises
    ------
    ProofError
        A name in the archive is not a plain file name.
    """
    folder.mkdir(parents=True)
    with zipfile.ZipFile(io.BytesIO(packed)) as archive:
        for name in archive.namelist():
            if name != Path(name).name or name in ("", ".", ".."):
                raise ProofError(
                    f"a packed campaign holds {name!r}, which is not a plain file name. Pack the folder again."
                )
            (folder / name).write_bytes(archive.read(name))


def check_campaign_only(folder: Path) -> None:
    """Raise ``ProofError`` if a campaign's folder holds anything but a descriptor and the recordings it lists."""
    descriptor = folder / DESCRIPTOR
    try:
        content = json.loads(descriptor.read_text(encoding="utf-8"))
        listed = {str(resource["path"]) for resource in content["resources"]}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ProofError(
            f"{descriptor} cannot be read ({type(error).__name__}). Start again in another folder."
        ) from None
    for path in sorted(folder.iterdir()):
        if path.name not in listed | {DESCRIPTOR}:
            raise ProofError(
                f"{path} is not a recording of that campaign, and a campaign for blind diagnosis must hold nothing "
                "else: it may reveal the truth. Remove it, or start again in another folder."
            )
    if revealing := _revealing_key(content):
        raise ProofError(
            f"{descriptor} has the key {revealing!r}, which may reveal what is concealed. "
            "Start again in another folder."
        )


def _revealing_key(value: Any) -> str:
    """The first key that may reveal the truth; empty if there is none."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if found := key if key.lower() in TELLING else _revealing_key(inner):
                return found
    elif isinstance(value, list):
        for inner in value:
            if found := _revealing_key(inner):
                return found
    return ""


def _files(folder: Path) -> list[Path]:
    """The files of a campaign's folder in the order of their names."""
    if not folder.is_dir():
        raise ProofError(f"{folder} is missing: the campaigns of a proof must stay where they were written.")
    found = sorted(folder.iterdir())
    for path in found:
        if not path.is_file():
            raise ProofError(f"{path} is not a file: a campaign of a proof is a descriptor and its recordings.")
    return found

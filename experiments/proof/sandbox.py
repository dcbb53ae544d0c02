"""The process of a blind diagnosis: the usual ``inkjet``, but monitored, and unable to import the concealed plant.

``python -m inkjet_env.experiments.proof.sandbox diagnose head-… --json verdict.json``. In addition to the command's
output, the current folder receives `SEEN`: every path and address that Python opened or listed outside the installation
and that folder.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

from inkjet_env.installation import PACKAGES
from inkjet_env.processes import end_with_parent

FORBIDDEN = ("experiments", "inkjet_env.experiments")
ALLOWED = tuple(f"inkjet_env.experiments{part}" for part in ("", ".proof", ".proof.sandbox"))
SYSTEM = ("/dev", "/proc", "/sys", "/etc", "/usr", "/bin", "/lib", "/lib64", "/opt")
SEEN = "seen.json"
PARENT = "INKJET_PROOF_PARENT"
"""Environment variable with the id of the process that waits for this one; by default it is the parent process."""
PATH_EVENTS = ("open", "os.listdir", "os.scandir")
OTHER_EVENTS = ("socket.connect", "subprocess.Popen", "os.system")


def watch(seen: set[str]) -> None:
    """From now on record opened paths in ``seen`` and refuse forbidden imports; this cannot be switched off."""

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if event in PATH_EVENTS:
            if isinstance(arguments[0], (str, bytes, os.PathLike)):
                seen.add(os.path.abspath(os.fsdecode(arguments[0])))
        elif event in OTHER_EVENTS:
            seen.add(f"{event} {arguments[0] if event != 'socket.connect' else arguments[1]}")
        elif event == "import":
            name = arguments[0]
            if name not in ALLOWED and any(name == p or name.startswith(f"{p}.") for p in FORBIDDEN):
                raise ImportError(f"{name} is not available to a blind diagnosis.")

    sys.addaudithook(hook)


def outside(seen: set[str], scratch: Path) -> list[str]:
    """The entries of ``seen`` that are neither in the installation nor in the scratch folder."""
    own = [sys.prefix, sys.base_prefix, *SYSTEM, str(scratch), *map(str, PACKAGES.values())]
    roots = {os.path.abspath(p) for p in own} | {os.path.realpath(p) for p in own}

    def inside(path: str) -> bool:
        return any(path == r or path.startswith(r + os.sep) for r in roots)

    return sorted(entry for entry in seen if not (inside(entry) and inside(os.path.realpath(entry))))


def main() -> None:
    """Run the command under monitoring."""
    end_with_parent(int(os.environ.get(PARENT, os.getppid())))
    scratch, seen = Path.cwd(), set[str]()
    watch(seen)
    from inkjet_env.cli.app import main as inkjet

    try:
        inkjet(sys.argv[1:])
    finally:
        text = json.dumps(outside(seen, scratch))
        (scratch / SEEN).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()

"""Blind diagnosis of one case: by a separate process in an empty folder that gets only a copy of the campaign."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from inkjet_env.experiments.execution.jobs import ONE_THREAD, WorkLostError
from inkjet_env.experiments.proof.campaign_files import ProofError, digest, unpack
from inkjet_env.experiments.proof.sandbox import PARENT, SEEN

ANSWER_FORMAT = "proof-answer/1"
TIME_LIMIT_S = 3600.0
REFUSED = 2
KEPT_OF_ENVIRONMENT = ("PATH", "SYSTEMROOT", "LD_LIBRARY_PATH")


def diagnose_blind(name: str, packed: bytes, sealed_digest: str, held_out: Sequence[str] = ()) -> dict[str, Any]:
    """The answer to one campaign.

    Parameters
    ----------
    name : str
        Opaque name of the campaign.
    packed : bytes
        Its files, from `campaign_files.pack`.
    sealed_digest : str
        Its SHA-256 in the manifest.
    held_out : sequence of str
        Names of the recordings to hold out; chosen by the diagnosis unless given.

    Returns
    -------
    dict
        ``answer``: status ("diagnosed", "refused" or "failed"), sentence, the ``diagnosis/1`` without its seconds, the
        augmented and the base printhead as ``printhead/1``, the ``requests`` for further recordings, each as in the
        ``diagnosis/1`` with ``drive_V`` and ``neighbour_V`` (None: at 0 V); ``run``: seconds, CPU seconds,
        paths opened elsewhere.

    Raises
    ------
    ProofError
        The campaign is not the one that was sealed.
    WorkLostError
        The process was killed.
    """
    with tempfile.TemporaryDirectory(prefix="inkjet-blind-") as place:
        scratch = Path(place)
        unpack(packed, scratch / name)
        if digest(scratch / name) != sealed_digest:
            raise ProofError(f"{name} is not the campaign that was sealed. Start again in another folder.")
        begin_s, begin_cpu_s = time.perf_counter(), _children_cpu_s()
        answer: dict[str, Any] = {
            "status": "diagnosed",
            "sentence": "",
            "verdict": None,
            "augmented": None,
            "base": None,
            "requests": [],
        }
        seen: set[str] = set()
        status, said = _inkjet(scratch, seen, "identify", name, "--out", "base.json")
        if status == 0:
            outputs = ("--json", "verdict.json", "--printhead-out", "augmented.json")
            held = ("--hold-out", ",".join(held_out)) if held_out else ()
            status, said = _inkjet(scratch, seen, "diagnose", name, *outputs, "--seed", "0", "--workers", "1", *held)
        if status == 0:
            for part in ("verdict", "augmented", "base"):
                answer[part] = json.loads((scratch / f"{part}.json").read_text(encoding="utf-8"))
            answer["verdict"].pop("seconds", None)
            answer["requests"] = _requests(answer["verdict"], scratch)
        else:
            answer |= {"status": "refused" if status == REFUSED else "failed", "sentence": said}
        run = {
            "seconds": round(time.perf_counter() - begin_s, 3),
            "cpu_seconds": round(_children_cpu_s() - begin_cpu_s, 3),
            "seen": sorted(seen),
        }
        return {"format": ANSWER_FORMAT, "name": name, "campaign": sealed_digest, "answer": answer, "run": run}


def _requests(verdict: Mapping[str, Any], scratch: Path) -> list[dict[str, Any]]:
    """The recordings that a verdict asks for, with their drives."""
    import numpy as np

    found = []
    for asked in (verdict["next_experiment"], *verdict["further_experiments"]):
        if asked is not None and asked["drive_csv"] is not None:
            table = np.genfromtxt(scratch / asked["drive_csv"], delimiter=",", names=True)
            neighbour = table["neighbour_V"].tolist() if "neighbour_V" in (table.dtype.names or ()) else None
            found.append(asked | {"drive_V": table["drive_V"].tolist(), "neighbour_V": neighbour})
    return found


def _inkjet(scratch: Path, seen: set[str], *arguments: str) -> tuple[int, str]:
    """Run the command in the sandbox; its exit status and, if that is not 0, its last line on standard error."""
    command = [sys.executable, "-m", "inkjet_env.experiments.proof.sandbox", *arguments]
    try:
        done = subprocess.run(
            command,
            cwd=scratch,
            env=clean_environment(scratch),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=TIME_LIMIT_S,
            start_new_session=True,
        )
    except subprocess.TimeoutExpired:
        return 1, f"inkjet {arguments[0]} took more than {TIME_LIMIT_S:g} s."
    if done.returncode < 0:
        raise WorkLostError(f"inkjet {arguments[0]} was killed by signal {-done.returncode}.")
    record = scratch / SEEN
    if record.exists():
        seen.update(json.loads(record.read_text(encoding="utf-8")))
        record.unlink()
    lines = done.stderr.decode(errors="replace").strip().splitlines()
    return done.returncode, _last_words(lines, scratch) if done.returncode else ""


def _last_words(lines: Sequence[str], scratch: Path) -> str:
    """The last line of a refusal or a traceback, without the scratch folder's name, which is random."""
    last = lines[-1] if lines else "it printed no message."
    return last.removeprefix("inkjet: ").replace(f"{scratch}{os.sep}", "")


def clean_environment(scratch: Path) -> Mapping[str, str]:
    """Environment of a blind process: paths of programs and of the package, one thread, a fixed hash seed."""
    kept = {name: os.environ[name] for name in KEPT_OF_ENVIRONMENT if name in os.environ}
    package = Path(__file__).resolve().parents[2]
    own = {"PYTHONPATH": str(package), "PYTHONHASHSEED": "0", "LANG": "C.UTF-8", "HOME": str(scratch)}
    return kept | ONE_THREAD | own | {"TMPDIR": str(scratch), PARENT: str(os.getpid())}


def _children_cpu_s() -> float:
    """CPU time in seconds of all child processes that this one has waited for."""
    times = os.times()
    return times.children_user + times.children_system

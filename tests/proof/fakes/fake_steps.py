"""What workers do to a case where nothing is to be found out: quick, but slow enough to be killed in between."""

import hashlib
import os
import signal
import time
import zipfile
from io import BytesIO
from pathlib import Path

from inkjet_env.experiments.proof.corpus import STAGES
from inkjet_env.experiments.proof.protocol import Steps, conceal_case


def answer(name, packed, sealed_digest, code):
    """Depends on the recordings alone; tells where it is at work, and by which process."""
    if place := os.environ.get("AT_WORK"):
        (Path(place) / f"{os.getpid()}").write_text(name)
    time.sleep(float(os.environ.get("ANSWER_SECONDS", "0")))
    with zipfile.ZipFile(BytesIO(packed)) as archive:
        chance = hashlib.sha256(archive.read("r001.csv")).digest()
    ids = list(STAGES)
    verdict = {
        "format": "diagnosis/1",
        "verdict": "named" if chance[0] % 3 else "none",
        "effects": [{"id": ids[chance[1] % len(ids)], "parameters": {}}] if chance[0] % 3 else [],
        "candidates": [],
    }
    told = {"status": "diagnosed", "sentence": "", "verdict": verdict, "augmented": None, "base": None, "requests": []}
    run = {"seconds": 0.1, "cpu_seconds": 0.1, "seen": []}
    return {"format": "proof-answer/1", "name": name, "campaign": sealed_digest, "answer": told, "run": run}


def judge(case, answer, packed, asked, rig, code):
    return {"said": [e["id"] for e in answer["verdict"]["effects"]], "truth": case["draw"]["effects"]}


def deadly(name):
    """Kills whoever works on it."""
    os.kill(os.getpid(), signal.SIGKILL)


STEPS = Steps(conceal_case, answer, judge)


def adapt(name, case, answer, waveforms, way, rig, code):
    """One round: asked as designed, one candidate is left; at random, all are."""
    verdict = answer["verdict"]
    if way == "designed":
        verdict = verdict | {"verdict": "named", "candidates": []}
    told = {**answer, "verdict": verdict, "requests": []}
    run = {"seconds": 0.1, "cpu_seconds": 0.1, "seen": []}
    entry = {"format": "proof-answer/1", "name": name, "campaign": "digest", "answer": told, "run": run}
    return {"rounds": [{"requests": [{"sentence": "", "repeats": 1}], "entry": entry}], "loop": None}

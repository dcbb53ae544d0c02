"""Whether a command that is killed at random, and started again, ends as one that was left alone.

``python -m inkjet_env.experiments.robustness.killed_commands optimize --kills 20``

The command runs once undisturbed. Then it is killed with SIGKILL after a random part of its time and started again,
until it ends; and all that anew, until it was killed so often. ``--within 0.1`` kills a long one often in one run.
Every file that it wrote must then hold the same, but for times and random names, and no process of it may be left. The
exit status is 1 if anything differs. ``--keep FOLDER`` keeps the files of both runs.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

INKJET = (sys.executable, "-m", "inkjet_env.experiments.cli")
CHANGING = (
    *("seconds", "elapsed", "cpu_seconds", "wall_seconds", "created", "judge"),
    *("campaign", "truth_sha256", "answers_sha256"),
)
"""Keys of JSON whose values are times, tell of the machine, or are digests of random names."""
SECONDS_TO_END = 30.0
"""Time within which all processes of a killed command must have ended."""


@dataclass(frozen=True)
class Killed:
    """A command that is killed.

    Attributes
    ----------
    arguments : tuple of str
        Behind ``inkjet``; run in the folder that its files go to.
    outputs : tuple of str
        Files or patterns whose contents are compared.
    prepare : tuple of tuple of str
        Commands run once in advance.
    record : str
        File from which the command goes on with ``--resume``; empty if the same command goes on by itself.
    cases : str
        File that tells the number of each case whose name is random; the numbers are compared.
    """

    arguments: tuple[str, ...]
    outputs: tuple[str, ...]
    prepare: tuple[tuple[str, ...], ...] = ()
    record: str = ""
    cases: str = ""


COMMANDS: Mapping[str, Killed] = {
    "optimize": Killed(
        ("optimize", "--optimizer", "cma-es", "--budget", "100000", "--out", "best.csv", "--json", "best.json"),
        ("best.csv", "best.json"),
        record="best.csv.evaluations.npz",
    ),
    "bench": Killed(
        (
            "bench", "--results", "bench", "--problems", "nominal,stiff-head", "--optimizers", "cma-es,pso,random",
            "--repeats", "20", "--budget", "2000",
        ),
        ("bench/ranking.csv", "bench/ranking.json"),
    ),
    "diagnose": Killed(
        (
            "diagnose", "campaign", "--json", "answer.json", "--printhead-out", "corrected.json",
            "--report", "answer.html",
        ),
        ("answer.json", "corrected.json", "next.csv"),
        prepare=(("record", "campaign", "--seed", "1", "--snr-db", "50"),),
    ),
    "prove": Killed(
        ("prove", "--quick", "--out", "proof", "--seed", "5"),
        ("proof/score.json", "proof/answers/*.json", "proof/judged/*.json"),
        cases="proof/sealed/truth.json",
    ),
    "identify": Killed(
        ("identify", "a", "b", "c", "d", "e", "f", "--out", "heads"),
        ("heads/*.json",),
        prepare=tuple(("record", name, "--seed", str(k)) for k, name in enumerate("abcdef")),
    ),
    "tune": Killed(
        ("tune", "bench", "--rig", "head.json", "--seed", "1", "--json", "tuned.json", "--waveform", "waveform.csv"),
        ("tuned.json", "waveform.csv", "bench-tuning/recorded/*.csv", "bench-tuning/proposals.json"),
        prepare=(("record", "campaign", "--seed", "1"), ("identify", "campaign", "--out", "head.json")),
    ),
}  # fmt: skip


def without_times(value: Any) -> Any:
    """JSON values without those under `CHANGING` keys."""
    if isinstance(value, dict):
        return {key: without_times(held) for key, held in value.items() if key not in CHANGING}
    return [without_times(held) for held in value] if isinstance(value, list) else value


def contents(folder: Path, outputs: Sequence[str], cases: str = "") -> dict[str, Any]:
    """What the outputs of a command hold, by name; with the numbers of ``cases`` in place of their names."""
    found: dict[str, Any] = {}
    named = numbered(folder, cases)
    for pattern in outputs:
        for file in folder.glob(pattern):
            text = named(file.read_text(encoding="utf-8"))
            found[named(file.relative_to(folder).as_posix())] = (
                without_times(json.loads(text)) if file.suffix == ".json" else text
            )
    return dict(sorted(found.items()))


def numbered(folder: Path, cases: str) -> Callable[[str], str]:
    """A function that puts numbers in place of the random names of cases in a text."""
    if not cases or not (folder / cases).exists():
        return str
    entries = json.loads((folder / cases).read_text(encoding="utf-8"))["cases"]
    numbers = {name: f"case-{case['draw']['number']}" for name, case in entries.items()}
    pattern = re.compile("|".join(map(re.escape, numbers)))
    return lambda text: pattern.sub(lambda match: numbers[match[0]], text)


def left_over(group: int) -> list[str]:
    """Command lines of processes that are still in a process group, zombies aside."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError, ValueError, IndexError):
            state, _, its_group = (entry / "stat").read_text().rpartition(")")[2].split()[:3]
            if int(its_group) == group and state != "Z":
                found.append((entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace"))
    return found


def killed_after(command: Sequence[str], folder: Path, seconds: float) -> bool:
    """Start a command and kill its first process after so many seconds; whether it was still running.

    Raises
    ------
    RuntimeError
        Other processes of the command were left over.
    """
    process = subprocess.Popen(
        command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(seconds)
        return False
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    end_s = time.monotonic() + SECONDS_TO_END
    while left := left_over(process.pid):
        if time.monotonic() > end_s:
            os.killpg(process.pid, signal.SIGKILL)
            raise RuntimeError(f"left over {SECONDS_TO_END:g} s after the kill: {left}")
        time.sleep(0.1)
    return True


def tried(
    killed: Killed, kills: int, seed: int, folder: Path, within: float = 1.0, tell: Callable[[str], None] = print
) -> list[str]:
    """Differences between a run that was killed and one that was not; empty if there are none.

    Parameters
    ----------
    killed : Killed
    kills : int
        Number of kills. A run that ends before all of them is followed by another from the start.
    seed : int
        Of the moments of the kills.
    folder : Path
        Empty folder for both runs.
    within : float
        Part of the undisturbed time after which a started command has been killed at the latest.
    tell : callable
        Told how it goes.

    Raises
    ------
    subprocess.CalledProcessError
        A command fails by itself.
    RuntimeError
        Processes outlive their command.
    """
    rng = np.random.default_rng(seed)
    whole = _prepared(killed, folder / "whole")
    start_s = time.monotonic()
    _run(killed.arguments, whole)
    seconds = time.monotonic() - start_s
    tell(f"undisturbed: {seconds:.1f} s")
    expected = contents(whole, killed.outputs, killed.cases)
    if not expected:
        return ["the undisturbed run wrote none of its outputs"]
    hit, runs, wrong = 0, 0, []
    while hit < kills:
        runs += 1
        disturbed = _prepared(killed, folder / f"disturbed-{runs}")
        ended = False
        while hit < kills and not ended:
            ended = not killed_after(_command(killed, disturbed), disturbed, float(rng.uniform(0.0, within * seconds)))
            hit += not ended
        if not ended:
            _run(_command(killed, disturbed)[len(INKJET) :], disturbed)
        found = contents(disturbed, killed.outputs, killed.cases)
        wrong += [f"{name} differs" for name in expected if expected[name] != found.get(name)]
        wrong += [f"{name} is left" for name in sorted(_names(disturbed, killed) - _names(whole, killed))]
    tell(f"killed {hit} times in {runs} {'run' if runs == 1 else 'runs'}")
    return wrong


def _prepared(killed: Killed, folder: Path) -> Path:
    """A new folder with what the command needs."""
    folder.mkdir()
    for arguments in killed.prepare:
        subprocess.run([*INKJET, *arguments], cwd=folder, check=True, capture_output=True)
    return folder


def _command(killed: Killed, folder: Path) -> list[str]:
    """The command as it is started (again)."""
    if killed.record and (folder / killed.record).exists():
        outputs = [a for name in ("--out", "--json") for a in _option(killed.arguments, name)]
        return [*INKJET, killed.arguments[0], "--resume", killed.record, *outputs]
    return [*INKJET, *killed.arguments]


def _option(arguments: Sequence[str], name: str) -> list[str]:
    return [name, arguments[arguments.index(name) + 1]] if name in arguments else []


def _run(arguments: Sequence[str], folder: Path) -> None:
    done = subprocess.run([*INKJET, *arguments], cwd=folder, capture_output=True, check=False)
    if done.returncode not in (0, 1):  # 1: a criterion of a proof is not met
        raise subprocess.CalledProcessError(done.returncode, done.args, done.stdout, done.stderr)


def _names(folder: Path, killed: Killed) -> set[str]:
    named = numbered(folder, killed.cases)
    return {named(file.relative_to(folder).as_posix()) for file in folder.rglob("*") if file.is_file()}


def _tell(name: str, text: str) -> None:
    print(f"{name}: {text}", flush=True)


@contextlib.contextmanager
def kept_folder(keep: Path | None, name: str) -> Iterator[Path]:
    """A new folder: one that stays, or a temporary one."""
    if keep is None:
        with tempfile.TemporaryDirectory() as folder:
            yield Path(folder)
    else:
        (keep / name).mkdir(parents=True)
        yield keep / name


def main() -> int:
    """Kill commands; the exit status."""
    parser = argparse.ArgumentParser(prog="python -m inkjet_env.experiments.robustness.killed_commands")
    parser.add_argument("commands", nargs="*", default=[*COMMANDS], choices=[[], *COMMANDS], metavar="COMMAND")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--within", type=float, default=1.0, help="part of its time after which a start is killed (1)")
    parser.add_argument("--keep", type=Path, help="new folder in which the files of both runs stay")
    given = parser.parse_args()
    failed = False
    for name in given.commands:
        with kept_folder(given.keep, name) as folder:
            wrong = tried(COMMANDS[name], given.kills, given.seed, folder, given.within, partial(_tell, name))
        failed |= bool(wrong)
        _tell(name, "; ".join(wrong) or "the same as undisturbed")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())

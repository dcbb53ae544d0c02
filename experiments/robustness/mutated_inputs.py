"""A fuzzer: mutated campaigns, drives, printheads, records and results of the comparison, and what becomes of each.

``python -m inkjet_env.experiments.robustness.mutated_inputs campaign --count 10000``

Each input starts whole and is then damaged in one to four places: bytes, numbers, rows and columns of text, values and
keys of JSON, names and kinds of files; half of those to be diagnosed by samples that are wrong but can be read. It must
be used, or be refused in one plain sentence: no other exception, no warning of NumPy, no hang, no file that is half
written. The exit status is 1 if any is not. A case is reproduced by ``--first SEED --count 1``.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import re
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.cli.app import main as inkjet
from inkjet_env.cli.campaign_reading import Reading
from inkjet_env.cli.exit_status import BAD_INPUT
from inkjet_env.experiments.robustness.damage import damage, damage_numbers
from inkjet_env.extras import extra
from inkjet_env.progress import shown_progress
from inkjet_env.recordings import Campaign, Recording, write_campaign
from inkjet_env.recordings.drive import read_drive
from inkjet_env.storage import UNFINISHED, write_json

SECONDS_ALLOWED = 60.0
"""Time after which a case counts as hanging; a diagnosis may take ten times as long."""
WAVEFORM = ("100", "-100", "1e-6", "10.49e-6", "13.74e-6", "9.81e-6", "19.96e-6")
JARGON = frozenset(
    ("codec", "broadcast", "singular", "errno", "dtype", "nonetype", "subscriptable", "unpack", "lapack", "iterable")
)
"""Words that no refusal may hold."""


class Hangs(BaseException):
    """A case takes longer than it may."""


@dataclass(frozen=True)
class Outcome:
    """What became of one input.

    Attributes
    ----------
    seed : int
        Seed that makes the input.
    kind : {"used", "refused", "failed"}
        Whether it was accepted, refused in a sentence, or handled wrongly.
    told : str
        The refusal, or what went wrong.
    """

    seed: int
    kind: str
    told: str


def small_campaign(rng: np.random.Generator) -> Campaign:
    """Three short recordings of a ringing head with noise, made by a plain oscillator."""
    step_s, omega, count = 1e-6, 2 * np.pi * 50e3, 160
    time_s = step_s * np.arange(count, dtype=np.float64)
    recordings = []
    for k, size_V in enumerate((40.0, 20.0, 30.0)):
        drive_V = size_V * np.interp(np.arange(count), [10, 14, 40, 44], [0.0, 1.0, 1.0, 0.0])
        x = p = 0.0
        sensor = np.zeros(count)
        for n in range(1, count):
            for _ in range(8):
                p += step_s / 8 * (omega**2 * (drive_V[n] - x) - 0.1 * omega * p)
                x += step_s / 8 * p
            sensor[n] = 0.01 * p / omega + rng.normal(0, 1e-3)
        recordings.append(
            Recording(f"r{k}", time_s, drive_V, sensor, "V", "self_sensing", initial_state="demagnetised", order=k + 1)
        )
    return Campaign("small", tuple(recordings))


def write_scope_files(folder: Path, campaign: Campaign, rng: np.random.Generator) -> None:
    """The recordings as files of an instrument, of a random delimiter, decimal sign, encoding and header."""
    delimiter, decimal = (",", ".") if rng.random() < 0.5 else (";", ",")
    encoding = str(rng.choice(["utf-8", "utf-8-sig", "utf-16", "latin-1"]))
    head = [["Model", "X1"], ["Sample Interval", "1e-06"]] if rng.random() < 0.5 else []
    head += [["Time", "drive", "sensor"], ["(s)", "(V)", "(V)"]]
    for r in campaign.recordings:
        rows = head + [[f"{v:.9g}" for v in row] for row in zip(r.time_s, r.drive_V, r.sensor, strict=True)]
        lines = [delimiter.join(cell.replace(".", decimal) for cell in row) for row in rows]
        (folder / f"{r.name}.csv").write_bytes("\r\n".join(lines).encode(encoding))


@dataclass(frozen=True)
class Kind:
    """A kind of input.

    Attributes
    ----------
    make : callable
        Writes a whole input into a folder.
    use : callable
        Uses the input in a folder; raises ``ValueError`` or ``OSError`` if it is refused.
    seconds : float
        Time that its use may take.
    readable : float
        Share of the inputs whose damage leaves them readable.
    """

    make: Callable[[Path, np.random.Generator], None]
    use: Callable[[Path], None]
    seconds: float = SECONDS_ALLOWED
    readable: float = 0.0


def _make_campaign(folder: Path, rng: np.random.Generator) -> None:
    campaign = small_campaign(np.random.default_rng(0))
    if rng.random() < 0.5:
        write_campaign(folder / "input", campaign)
    else:
        (folder / "input").mkdir()
        write_scope_files(folder / "input", campaign, rng)


def _read_campaign(folder: Path) -> None:
    reading = Reading(channel="self_sensing")
    reading.warnings(reading.campaign(folder / "input"))


def _make_drive(folder: Path, rng: np.random.Generator) -> None:
    from inkjet_env.recordings.segment_file import write_segments

    (folder / "input").mkdir()
    campaign = small_campaign(np.random.default_rng(0))
    if rng.random() < 0.5:
        write_segments(
            folder / "input" / "drive.ini",
            np.arange(5, dtype=np.float64) * 1e-6,
            np.array([0.0, 40.0, 40.0, -20.0, 0.0]),
        )
    else:
        write_scope_files(folder / "input", replace(campaign, recordings=campaign.recordings[:1]), rng)


def _read_drive(folder: Path) -> None:
    for file in sorted((folder / "input").iterdir()):
        read_drive(file)


def _make_printhead(folder: Path, rng: np.random.Generator) -> None:
    (folder / "input").mkdir()
    write_json(folder / "input" / "printhead.json", _augmented() if rng.random() < 0.5 else _plain())


@cache
def _plain() -> dict[str, Any]:
    from inkjet_env.identification import identify

    return identify(small_campaign(np.random.default_rng(0))).as_json()


@cache
def _augmented() -> dict[str, Any]:
    from inkjet_env.plant import catalogue

    chosen = [effect for effect in catalogue() if effect.id in ("second_mode", "sensor_bandwidth", "cubic_stiffness")]
    middles = [{p.name: {"value": p.value(sum(p.bounds) / 2)} for p in effect.parameters} for effect in chosen]
    return _plain() | {"effects": [{"id": e.id, "parameters": m} for e, m in zip(chosen, middles, strict=True)]}


def _simulate(folder: Path) -> None:
    for file in sorted((folder / "input").iterdir()):
        _command("simulate", "--waveform", *WAVEFORM, "--printhead", str(file), "--json", "-")


@cache
def _record(optimizer: str) -> bytes:
    """The record of a short run."""
    from inkjet_env.experiments.benchmark.single_run import Optimisation, write_record
    from inkjet_env.experiments.benchmark.suite import problem

    plan = Optimisation(problem("nominal"), optimizer, 80, 3)
    with tempfile.TemporaryDirectory() as place, contextlib.redirect_stderr(io.StringIO()):
        write_record(Path(place, "r.npz"), plan, plan.carry_out())
        return Path(place, "r.npz").read_bytes()


def _make_record(folder: Path, rng: np.random.Generator) -> None:
    (folder / "input").mkdir()
    (folder / "input" / "part.npz").write_bytes(_record(str(rng.choice(["pso", "random"]))))


def _resume(folder: Path) -> None:
    from inkjet_env.experiments.benchmark.single_run import read_record

    for file in sorted((folder / "input").iterdir()):
        read_record(file)


def _bench_settings() -> Any:
    from inkjet_env.experiments.benchmark.settings import BenchSettings

    return BenchSettings.default(optimizers=("random", "pso"), problems=("nominal",), repeats=2, budget=80, seed=1)


@cache
def _finished_bench() -> dict[str, bytes]:
    """Files of a small comparison that has ended, by their paths."""
    from inkjet_env.experiments.benchmark.runner import run_bench

    with tempfile.TemporaryDirectory() as place:
        run_bench(_bench_settings(), Path(place), 1)
        return {
            str(file.relative_to(place)): file.read_bytes() for file in sorted(Path(place).rglob("*")) if file.is_file()
        }


def _make_results(folder: Path, rng: np.random.Generator) -> None:
    for name, content in _finished_bench().items():
        (folder / "input" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "input" / name).write_bytes(content)


def _compare(folder: Path) -> None:
    from inkjet_env.experiments.benchmark.analysis import Comparison
    from inkjet_env.experiments.benchmark.runner import run_bench

    Comparison(run_bench(_bench_settings(), folder / "input", 1))


def _diagnose(folder: Path) -> None:
    outputs = ("--json", str(folder / "verdict.json"), "--report", str(folder / "report.html"))
    _command("diagnose", str(folder / "input"), "--channel", "self_sensing", "--workers", "1", *outputs)


def _command(*arguments: str) -> None:
    """Run the command in this process; ``ValueError`` with its sentence if it refuses."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            inkjet(list(arguments))
        except SystemExit as ended:
            status = ended.code
    if status:
        last = err.getvalue().strip().splitlines()[-1:] or ["nothing was said"]
        assert status == BAD_INPUT, f"exit status {status}: {last[0]}"
        raise ValueError(last[0].removeprefix("inkjet: "))


KINDS = {
    "campaign": Kind(_make_campaign, _read_campaign),
    "drive": Kind(_make_drive, _read_drive),
    "printhead": Kind(_make_printhead, _simulate),
    "record": Kind(_make_record, _resume),
    "results": Kind(_make_results, _compare),
    "diagnose": Kind(_make_campaign, _diagnose, 10 * SECONDS_ALLOWED, readable=0.5),
}


def outcome_of(name: str, seed: int) -> Outcome:
    """Make, damage and use the input of a seed."""
    kind, rng = KINDS[name], np.random.default_rng([seed, *name.encode()])
    with tempfile.TemporaryDirectory(prefix="inkjet-mutated-") as place:
        folder = Path(place)
        kind.make(folder, rng)
        hurt = damage_numbers if rng.random() < kind.readable else damage
        for _ in range(int(rng.integers(1, 5))):
            hurt(folder / "input", rng)
        found = _used(seed, kind, folder)
        left = [path.name for path in folder.rglob("*") if UNFINISHED in path.name]
        if left:
            found = Outcome(seed, "failed", f"{left[0]} was left behind")
        for pipe in folder.rglob("*"):
            if not pipe.is_dir() or pipe.is_symlink():
                pipe.unlink()
        shutil.rmtree(folder / "input", ignore_errors=True)
    return found


def is_plain(told: str) -> bool:
    """Whether a refusal is one sentence or two without a programmer's words outside of quotes."""
    words = set(re.findall(r"[a-z]+", re.sub(r"'[^']*'", "", told).lower()))
    return 20 <= len(told) <= 700 and told[-1] in ".?!`)" and len(told.splitlines()) == 1 and not JARGON & words


def _used(seed: int, kind: Kind, folder: Path) -> Outcome:
    def hangs(*_: object) -> None:
        raise Hangs

    before = signal.signal(signal.SIGALRM, hangs)
    signal.setitimer(signal.ITIMER_REAL, kind.seconds)
    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            kind.use(folder)
        if warned:
            first = warned[0]
            return Outcome(seed, "failed", f"{first.category.__name__} at {first.filename}:{first.lineno}")
        return Outcome(seed, "used", "")
    except (ValueError, OSError) as error:
        told = str(error).replace(str(folder), "")
        if isinstance(error, OSError) or is_plain(told):
            return Outcome(seed, "refused", told)
        return Outcome(seed, "failed", f"not plain: {told}")
    except Hangs:
        return Outcome(seed, "failed", f"took more than {kind.seconds:g} s: {traceback.format_exc(limit=-3)}")
    except Exception:
        return Outcome(seed, "failed", traceback.format_exc(limit=-3))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def main(arguments: Sequence[str] | None = None) -> int:
    """Try the inputs that the command line asks for, tell what failed, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("--count", type=int, default=1000, help="number of inputs (1000)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first (0)")
    parser.add_argument("--workers", type=int, default=1, help="number of processes (1)")
    parser.add_argument("--all", action="store_true", help="tell every outcome, not only what failed")
    given = parser.parse_args(arguments)
    with extra("the fuzzer"):
        from joblib import Parallel, delayed

    counts: Counter[str] = Counter()
    with shown_progress(given.kind, given.count) as progress:
        seeds = range(given.first, given.first + given.count)
        finished = Parallel(n_jobs=given.workers, return_as="generator")(
            delayed(outcome_of)(given.kind, seed) for seed in seeds
        )
        for done, outcome in enumerate(finished, start=1):
            counts[outcome.kind] += 1
            if given.all or outcome.kind == "failed":
                print(f"{outcome.seed:6d} {outcome.kind:8s} {outcome.told}", flush=True)
            progress(done)
    print(", ".join(f"{kind}: {count}" for kind, count in sorted(counts.items())))
    return int(counts["failed"] > 0)


if __name__ == "__main__":
    from inkjet_env.experiments.robustness import mutated_inputs  # workers find its functions, not those of __main__

    sys.exit(mutated_inputs.main())

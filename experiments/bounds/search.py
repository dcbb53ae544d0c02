"""Search for a proof that no waveform of a problem costs less than a bound: branch and bound.

``python -m inkjet_env.experiments.bounds.search nominal --bound -24 --folder results/bound`` divides the waveforms by
their largest extremum, and each part into boxes, halved until each has a lower bound that is good enough. What is
proven is kept: the same command goes on after an interruption. The folder is the certificate, for
``inkjet_env.experiments.bounds.verification``.
"""

from __future__ import annotations

import argparse
import json
import lzma
import math
import os
import shutil
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

import numpy as np

from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.experiments.benchmark.suite import problem
from inkjet_env.experiments.bounds.tables import SPENT, Tables
from inkjet_env.experiments.bounds.task import TABLES, Settings, parts_of, task_of
from inkjet_env.experiments.bounds.tree import FULL, PROVED, STOPPED, STUCK, influences, prove
from inkjet_env.experiments.execution.held_folder import held
from inkjet_env.progress import shown_progress
from inkjet_env.storage import json_text, remove_unfinished, write_atomically
from inkjet_env.typing import Real

MODULE = "inkjet_env.experiments.bounds.search"
FORMAT = "lower-bound/1"


def halved(lower: Real, upper: Real, sides: Sequence[int]) -> tuple[Real, Real]:
    """The part of a box after halvings: ``side`` where the lower half is kept, ``~side`` where the upper one is."""
    lower, upper = lower.copy(), upper.copy()
    for side in sides:
        k = side if side >= 0 else ~side
        middle = 0.5 * (lower[k] + upper[k])
        if side >= 0:
            upper[k] = middle
        else:
            lower[k] = middle
    return lower, upper


class Search:
    """A proof that is under way in a folder.

    Parameters
    ----------
    folder : Path
        Folder of the certificate.
    one : Problem
    bound_V : float
        What is to be proven, in volts.
    threads : int
        Number of threads.
    settings : Settings, optional
    """

    def __init__(
        self, folder: Path, one: Problem, bound_V: float, threads: int = 1, settings: Settings | None = None
    ) -> None:
        self.folder, self.threads, self.bound_V = folder, threads, bound_V
        self.settings = settings or Settings()
        self.task = task_of(one)
        self.parts = parts_of(self.task, bound_V, self.settings.width, self.settings.growth)
        self.influence = influences(self.task.head, self.task.lower, self.task.upper)
        self.stop = np.zeros(1, np.int64)
        self.header = {
            "format": FORMAT,
            "problem": {"name": one.name, **one.settings()},
            "bound_V": bound_V,
            "parts": [list(limits) for limits in self.parts],
        }
        self.kept = folder / "certificate.json"
        if self.kept.exists() and json.loads(self.kept.read_text()) != self.header:
            raise ValueError(f"{self.kept} is for another problem, bound or division. Give another folder.")
        folder.mkdir(parents=True, exist_ok=True)
        remove_unfinished(folder)
        write_atomically(self.kept, json_text(self.header))

    def pieces(self) -> list[tuple[list[int], Real, Real]]:
        """The pieces of the box of all waveforms, with the halvings that lead to them, in the certificate's order."""
        found: list[tuple[list[int], Real, Real]] = [([], self.task.lower, self.task.upper)]
        for _ in range(self.settings.pieces):
            found = [
                ([*sides, way], *halved(self.task.lower, self.task.upper, [*sides, way]))
                for sides, lower, upper in found
                for side in [int(np.argmax(self.influence[:5] * (upper - lower)[:5]))]
                for way in (side, ~side)
            ]
        return found

    def run(self, seconds: float = math.inf) -> None:
        """Prove what is not proven yet, for so long.

        Raises
        ------
        ValueError
            A box cannot be proven: the bound does not hold, or is too close to the least cost.
        """
        begun = time.monotonic()
        ready: Tables | None = None
        for number, limits in enumerate(self.parts):
            if self.file(number).exists():
                continue
            if ready is None:
                ready = Tables(self.task, self.settings, self.threads)
                ready.prepare(self.folder)
            if time.monotonic() - begun > seconds:
                break
            self._part(number, limits, ready, begun + seconds)
        if all(self.file(number).exists() for number in range(len(self.parts))):
            (self.folder / "tables.npz").unlink(missing_ok=True)

    def file(self, number: int) -> Path:
        """File of the tree of a part."""
        return self.folder / f"part-{number:02}.xz"

    def _part(self, number: int, limits: tuple[float, float], ready: Tables, until: float) -> None:
        folder = self.folder / f"part-{number:02}"
        folder.mkdir(exist_ok=True)
        remove_unfinished(folder)
        pieces, told, tables = self.pieces(), self.settings, ready.for_part(limits)
        write_atomically(folder / SPENT, json_text({"seconds": _seconds(folder / SPENT) + ready.seconds}))
        files = [folder / f"{k:04}.xz" for k in range(len(pieces))]
        left = [k for k, file in enumerate(files) if not file.exists()]

        def work(k: int) -> None:
            if self.stop[0]:
                return
            lower, upper = pieces[k][1].copy(), pieces[k][2].copy()
            symbols, counts = np.empty(told.most, np.uint8), np.zeros(4, np.int64)
            began = time.thread_time()
            ended = prove(
                self.task.head, self.task.weights, self.task.ring, limits, self.bound_V, self.influence,
                told.thresholds, lower, upper, told.steps, *tables, ready.low_b, ready.high_b, ready.shape, told.finest,
                told.deepest, symbols, counts, self.stop,
            )  # fmt: skip
            if ended == STOPPED:
                return
            if ended != PROVED:
                why = {STUCK: "cannot be proven", FULL: "is divided into too many boxes"}[ended]
                box = ", ".join(f"{low:.6g} to {high:.6g}" for low, high in zip(lower, upper, strict=True))
                raise ValueError(
                    f"{self.bound_V:g} V is not proven: with the largest extremum between {limits[0]:.4f} and "
                    f"{limits[1]:.4f} V, the box of waveforms {box} (U1 and −U2 in V, durations in µs) {why}. Give a "
                    "lower bound."
                )
            spent = {"bounds": [int(n) for n in counts[:3]], "seconds": time.thread_time() - began}
            write_atomically(files[k].with_suffix(".json"), json_text(spent))
            write_atomically(files[k], lzma.compress(symbols[: counts[3]].tobytes(), preset=1))

        label = f"largest extremum {limits[0]:.3f} to {limits[1]:.3f} V"
        with (
            ThreadPoolExecutor(self.threads) as pool,
            shown_progress(label, len(files), len(files) - len(left)) as show,
        ):
            done = len(files) - len(left)
            running = [pool.submit(work, k) for k in left]
            try:
                for one in as_completed(running):
                    one.result()
                    done += not self.stop[0]
                    show(done)
                    if time.monotonic() > until:
                        self.stop[0] = 1
            except BaseException:
                self.stop[0] = 1
                raise
        if all(file.exists() for file in files):
            self._join(number, pieces, files, _seconds(folder / SPENT))
            shutil.rmtree(folder)

    def _join(self, number: int, pieces: list[tuple[list[int], Real, Real]], files: list[Path], spent: float) -> None:
        """Write the tree of a part into one file: each box before its lower and its upper half.

        ``spent`` are the seconds of its tables.
        """
        stream, bounds = bytearray(), np.zeros(3)
        before: list[int] = []
        for (sides, _, _), file in zip(pieces, files, strict=True):
            same = next((k for k, (a, b) in enumerate(zip(before, sides, strict=False)) if a != b), len(before))
            # where the lower half is left for the upper one the box has been written
            stream += bytes(side for side in sides[same + 1 if before else 0 :])
            stream += lzma.decompress(file.read_bytes())
            told = json.loads(file.with_suffix(".json").read_text())
            spent, bounds = spent + told["seconds"], bounds + told["bounds"]
            before = sides
        count = {"boxes": len(stream), "bounds": [int(n) for n in bounds], "seconds": spent}
        write_atomically(self.file(number).with_suffix(".json"), json_text(count))
        write_atomically(self.file(number), lzma.compress(bytes(stream), preset=6))


def _seconds(file: Path) -> float:
    """The processor's seconds that a file tells; 0 where there is none."""
    return float(json.loads(file.read_text())["seconds"]) if file.exists() else 0.0


def main(arguments: list[str] | None = None) -> None:
    """Search from the command line."""
    parser = argparse.ArgumentParser(prog=f"python -m {MODULE}", description=__doc__)
    parser.add_argument("problem", help="name of a problem of the suite")
    parser.add_argument("--bound", type=float, required=True, help="bound in volts")
    parser.add_argument("--folder", type=Path, required=True, help="folder of the certificate")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="number of threads; one per core")
    parser.add_argument(
        "--tables",
        choices=TABLES,
        default="coarse",
        help="fine ones take longer, and pay where the bound is close to the least cost",
    )
    parser.add_argument("--hours", type=float, default=math.inf, help="time after which the search pauses")
    chosen = parser.parse_args(arguments)
    if chosen.bound >= 0 or chosen.workers < 1:
        parser.error("--bound must be below 0 and --workers at least 1.")
    try:
        with held(chosen.folder, "search"):
            search = Search(chosen.folder, problem(chosen.problem), chosen.bound, chosen.workers, TABLES[chosen.tables])
            search.run(3600 * chosen.hours)
            left = sum(not search.file(k).exists() for k in range(len(search.parts)))
    except ValueError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    except KeyboardInterrupt:
        print(f"Interrupted; what is proven is kept in {chosen.folder}.", file=sys.stderr)
        sys.exit(130)
    if left:
        print(f"{left} of {len(search.parts)} parts are left; the same command goes on.")
    else:
        print(f"{chosen.problem}: no waveform costs less than {chosen.bound:g} V.")


if __name__ == "__main__":
    main()

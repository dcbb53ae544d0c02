"""Check of a whole certificate: its problem, the cover of the largest extremum's range, and the tree of every part.

Where the largest ``|extremum|`` ``M`` is at most ``bound / A``, the cost is at least ``A M ≥ bound``. Nowhere is ``M``
above the total variation of ``v`` times the gain. The parts must cover the range between; each is a tree of boxes that
covers the whole box of waveforms.

Where ``t5`` has a wide range, leaves may leave it whole: tables of the cost to go are filled first, see `tables`.
Nothing of them is kept from one check to the next.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkjet_env.experiments.bounds.verification import enclosing, leaves, walking
from inkjet_env.experiments.bounds.verification.reading import (
    DESCRIPTION,
    Certificate,
    CertificateError,
    chunks,
    part_file,
    read_certificate,
)
from inkjet_env.experiments.bounds.verification.tables import (
    Resolution,
    TableMaker,
    Tables,
    no_tables,
    table_maker,
)
from inkjet_env.progress import shown_progress

POLL_S = 0.2
"""How often the work is asked how far it is, in seconds."""
Array = NDArray[np.float64]


@dataclass
class Summary:
    """What was verified.

    Attributes
    ----------
    bound_V : float
        The bound in V.
    parts, of_parts : int
        Number of parts that were verified, and of all.
    boxes, leaves, divisions : int
        Number of boxes and leaves of the trees, and of further divisions of leaves.
    taken_s : float
        How long it took, in seconds.
    """

    bound_V: float
    parts: int
    of_parts: int
    boxes: int
    leaves: int
    divisions: int
    taken_s: float

    @property
    def whole(self) -> bool:
        """Whether the whole certificate was verified."""
        return self.parts == self.of_parts


@dataclass
class Problem:
    """A problem in numbers, as the compiled functions take it.

    Attributes
    ----------
    k : array
        Constants, indexed by the names in `enclosing`; V and µs.
    law : array
        Coefficients of the branch law's slope, lowest power first.
    sup1, sup2 : float
        Bounds of the modulus of the branch law's slope and of its derivative.
    peak_V : float
        Bound of the modulus of the response over the box.
    """

    k: Array
    law: Array
    sup1: float
    sup2: float
    peak_V: float


@dataclass
class _Part:
    """How far the work on a part is."""

    number: int
    path: Path
    counted: NDArray[np.int64] = field(default_factory=lambda: np.zeros(walking.COUNTED, np.int64))


def problem_of(certificate: Certificate) -> Problem:
    """The problem in numbers.

    Raises
    ------
    CertificateError
        The branch law falls somewhere.
    """
    sigma = certificate.a1 / 2
    omega = math.sqrt(certificate.a0 - sigma * sigma)
    half_us = math.pi / omega * 1e6
    degree = len(certificate.coefficients) - 1
    law = np.array([power * certificate.coefficients[degree - power] for power in range(1, degree + 1)], float)
    least, sup1 = polynomial_range(law)
    if not least >= 0:
        raise CertificateError(f"{DESCRIPTION}: the branch law may fall between 0 and its full scale.")
    bend = np.array([power * law[power] for power in range(1, len(law))] or [0.0])
    low, high = polynomial_range(bend)
    k = np.zeros(10)
    k[enclosing.SIGMA] = sigma / 1e6
    k[enclosing.OMEGA] = omega / 1e6
    k[enclosing.LAMBDA] = math.sqrt(certificate.a0) / 1e6
    k[enclosing.GAIN] = certificate.b1 / omega
    k[enclosing.SCALE] = certificate.full_scale_V
    k[enclosing.A_WEIGHT] = certificate.A
    k[enclosing.B_WEIGHT] = certificate.B
    k[enclosing.RING] = math.exp(-sigma * math.pi / omega)
    k[enclosing.COUNT] = max(3, math.floor((certificate.window_us - sum(certificate.upper[2:])) / half_us - 1e-9))
    a, b, scale = certificate.upper[0], certificate.upper[1], certificate.full_scale_V

    def law_at(x: float) -> float:
        inside = min(x, 1.0)
        value = sum(c / (power + 1) * inside ** (power + 1) for power, c in enumerate(law))
        return float(value + (x - inside) * law.sum())

    # up by at most Q((a + b)/F) − Q(b/F), down by Q((a + b)/F), up by Q(b/F)
    variation = scale * 2 * law_at((a + b) / scale)
    return Problem(k, law, sup1, max(abs(low), abs(high)), k[enclosing.GAIN] * variation * (1 + 1e-9))


def polynomial_range(law: Array, pieces: int = 4096) -> tuple[float, float]:
    """Bounds of a polynomial over 0 … 1 from its values at equal distances and a bound of its second derivative.

    Parameters
    ----------
    law : array
        Coefficients, lowest power first.
    pieces : int
        Number of distances.
    """
    x = np.linspace(0.0, 1.0, pieces + 1)
    values = np.polynomial.polynomial.polyval(x, law)
    second = sum(abs(c) * power * (power - 1) for power, c in enumerate(law))
    off = float(second) / pieces**2 / 8 + 1e-12 * float(np.abs(law).sum())
    return float(values.min()) - off, float(values.max()) + off


def check_cover(certificate: Certificate, peak_V: float) -> None:
    """Refuse parts that leave a gap.

    Raises
    ------
    CertificateError
        A value of the largest ``|extremum|`` that needs a part has none.
    """
    reached = certificate.bound_V / certificate.A
    for least, most in sorted(certificate.parts):
        if least > reached:
            break
        reached = max(reached, most)
    if reached < peak_V:
        text = f"no part covers a largest |extremum| just above {reached:.9g} V; up to {peak_V:.9g} V may occur."
        raise CertificateError(f"{DESCRIPTION}: {text}")


def check(
    folder: Path | str, workers: int = 1, part: int | None = None, resolution: Resolution | None = None
) -> Summary:
    """Check a certificate.

    Parameters
    ----------
    folder : path
        Folder of the certificate.
    workers : int
        Number of threads: they share the tables that all parts have in common, and check parts at the same time.
    part : int, optional
        Check this part alone, counted from 0.
    resolution : Resolution, optional
        How fine the tables are; it decides how fast the check is, not what it accepts.

    Raises
    ------
    CertificateError
        The certificate is malformed, of a problem that is not covered, or a claim of it could not be shown.
    """
    began_s = time.monotonic()
    folder = Path(folder)
    certificate = read_certificate(folder)
    problem = problem_of(certificate)
    check_cover(certificate, problem.peak_V)
    total = len(certificate.parts)
    if part is not None and not 0 <= part < total:
        raise CertificateError(f"{folder / DESCRIPTION}: has no part {part}; its {total} parts count from 0.")
    numbers = range(total) if part is None else [part]
    parts = [_Part(number, folder / part_file(number)) for number in numbers]
    for one in parts:
        if not one.path.is_file():
            raise CertificateError(f"{one.path}: is missing.")
    stop = np.zeros(1, np.int64)
    with ThreadPoolExecutor(max(1, workers)) as pool:
        maker = _table_maker(certificate, problem, resolution or Resolution())
        if maker is not None:
            with shown_progress("Verification, tables", maker.ranges) as progress:
                _finish(maker.fill_base(stop, pool), stop, progress, lambda: "")
        with shown_progress("Verification, parts", len(parts)) as progress:
            submitted = [pool.submit(_check_part, certificate, problem, maker, one, stop) for one in parts]
            _finish(
                submitted, stop, progress, lambda: f"{sum(int(one.counted[walking.LEAVES]) for one in parts)} leaves"
            )
    counted = sum((one.counted for one in parts), np.zeros(walking.COUNTED, np.int64))
    boxes, leaf_count, divisions = (int(value) for value in counted[:3])
    return Summary(certificate.bound_V, len(parts), total, boxes, leaf_count, divisions, time.monotonic() - began_s)


def _finish(
    submitted: Iterable[Future[None]],
    stop: NDArray[np.int64],
    progress: Callable[[int, str], object],
    told: Callable[[], str],
) -> None:
    """Wait until all work is done; if some of it fails, or on Ctrl-C, stop the rest."""
    waiting: list[Future[None]] = []
    try:
        for future in submitted:
            waiting.append(future)
        total = len(waiting)
        while waiting:
            wait(waiting, timeout=POLL_S)
            done = [future for future in waiting if future.done()]
            for future in done:
                future.result()
            waiting = [future for future in waiting if future not in done]
            progress(total - len(waiting), told())
    except BaseException:
        stop[0] = 1
        for future in waiting:
            future.cancel()
        raise


def _table_maker(certificate: Certificate, problem: Problem, resolution: Resolution) -> TableMaker | None:
    """What fills the tables; None where no leaf is too wide for a bound without them, or they would take too much."""
    lower, upper = certificate.lower, certificate.upper
    if (upper[leaves.T5] - lower[leaves.T5]) / 2 <= leaves.COARSE_LAST_US:
        return None
    numbers = (problem.k, problem.law, problem.sup1, problem.sup2, float(problem.peak_V))
    return table_maker(*numbers, lower, upper, resolution)


_compiling = threading.Lock()


def _check_part(
    certificate: Certificate, problem: Problem, maker: TableMaker | None, part: _Part, stop: NDArray[np.int64]
) -> None:
    least, most = certificate.parts[part.number]
    lows, highs, top = walking.first_boxes(certificate.lower, certificate.upper)
    failed = np.empty((2, walking.SIDES))
    work = walking.memory()
    tables: Tables = no_tables() if maker is None else maker.for_part(least, most, stop)

    def walk(data: NDArray[np.uint8], top: int) -> tuple[int, int]:
        found: Any = walking.walk(
            data, lows, highs, top, part.counted, least, most, certificate.bound_V,
            problem.k, problem.law, problem.sup1, problem.sup2, tables, stop, failed, work,
        )  # fmt: skip
        return int(found[0]), int(found[1])

    with _compiling:
        walk(np.empty(0, np.uint8), top)
    for data in chunks(part.path):
        ended, top = walk(np.array(bytearray(data), np.uint8), top)
        if ended == walking.STOPPED:
            return
        if ended != walking.GOING_ON:
            raise CertificateError(f"{part.path}: {_refusal(ended, part, failed)}")
    if top >= 0:
        raise CertificateError(f"{part.path}: its tree ends before its last box.")


def _refusal(ended: int, part: _Part, failed: Array) -> str:
    """Why the walk over a part ended, as the end of a sentence."""
    box = int(part.counted[walking.BOXES])
    if ended == walking.AFTER_END:
        return "something follows the end of its tree."
    if ended == walking.NO_SUCH_BYTE:
        return f"byte {box} is none of 0 to 7."
    if ended == walking.NO_WIDTH:
        return f"byte {box - 1} halves a side without width."
    if ended == walking.TOO_DEEP:
        return f"byte {box - 1} is deeper than {walking.DEEPEST} halvings."
    names = ("U1", "−U2", "t1", "t2", "t3", "t4", "t5")
    sides = ", ".join(f"{name} {low:.9g}…{high:.9g}" for name, low, high in zip(names, *failed, strict=True))
    leaf = int(part.counted[walking.LEAVES])
    return f"the claim of leaf {leaf} of part {part.number} could not be shown, within its box {sides} (V, µs)."

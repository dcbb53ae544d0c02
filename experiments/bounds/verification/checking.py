"""Check of a whole certificate: its problem, the cover of the largest extremum's range, and the tree of every part.

Where the largest ``|extremum|`` ``M`` is at most ``bound / A``, the cost is at least ``A M ≥ bound``. Nowhere is ``M``
above the total variation of ``v`` times the gain. The parts must cover the range between; each is a tree of boxes that
covers the whole box of waveforms.

Where ``t5`` has a wide range, leaves may leave it whole: tables of the cost to go are filled first, see `tables`.
Nothing of them is kept from one check to the next.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

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
T = TypeVar("T")


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
    bounds : tuple of 3 ints
        How many bounds were computed: up to the dwell, up to the last edge, and up to the end.
    taken_s : float
        How long it took, in seconds.
    """

    bound_V: float
    parts: int
    of_parts: int
    boxes: int
    leaves: int
    divisions: int
    bounds: tuple[int, int, int]
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
        Number of threads.
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
    for number in numbers:
        if not (path := folder / part_file(number)).is_file():
            raise CertificateError(f"{path}: is missing.")
    stop = np.zeros(1, np.int64)
    parts = [_Part(certificate, problem, number, folder / part_file(number), stop) for number in numbers]
    for one in parts:
        for _ in one.pieces():  # what is damaged is refused before the long work
            pass
    counted = np.zeros(walking.COUNTED, np.int64)
    with ThreadPoolExecutor(max(1, workers)) as pool:
        maker = _table_maker(certificate, problem, resolution or Resolution())
        if maker is not None:
            _finish("Verification, tables for all parts", maker.fill_base(stop, pool), stop)
        for one in parts:
            tables = no_tables()
            if maker is not None:
                tables = maker.part_tables()
                of_part = maker.fill_part(tables, *certificate.parts[one.number], stop, pool)
                _finish(f"Verification, tables for part {one.number}", of_part, stop)
            checks = (pool.submit(one.check, piece, tables) for piece in one.pieces())
            counted += sum(_finish(f"Verification, part {one.number}", checks, stop))
    boxes, leaf_count, divisions, *bounds = (int(value) for value in counted)
    counts = boxes, leaf_count, divisions, (bounds[0], bounds[1], bounds[2])
    return Summary(certificate.bound_V, len(numbers), total, *counts, time.monotonic() - began_s)


def _finish(label: str, submitted: Iterable[Future[T]], stop: NDArray[np.int64]) -> list[T]:
    """Wait until all work is done, and return what it tells; if some of it fails, or on Ctrl-C, stop the rest."""
    told: list[T] = []
    waiting: list[Future[T]] = []
    try:
        waiting.extend(submitted)
        total = len(waiting)
        with shown_progress(label, total) as progress:
            while waiting:
                done = wait(waiting, timeout=POLL_S, return_when=FIRST_COMPLETED).done
                told.extend(future.result() for future in done)
                waiting = [future for future in waiting if future not in done]
                progress(len(told))
    except BaseException:
        stop[0] = 1
        for future in waiting:
            future.cancel()
        raise
    return told


class _Piece(NamedTuple):
    """Some bytes of a tree.

    Attributes
    ----------
    data : array of uint8
        The bytes.
    lows, highs : arrays of shape (boxes, 7)
        The boxes that are still to come.
    leaves : int
        Number of leaves before it.
    """

    data: NDArray[np.uint8]
    lows: Array
    highs: Array
    leaves: int


class _Part:
    """The work on a part.

    Parameters
    ----------
    certificate : Certificate
    problem : Problem
    number : int
        Its number.
    path : Path
        Its file.
    stop : array of shape (1,)
        The work ends early as soon as this is not 0.
    """

    def __init__(
        self, certificate: Certificate, problem: Problem, number: int, path: Path, stop: NDArray[np.int64]
    ) -> None:
        self.number, self.path = number, path
        self._box, self._stop = (certificate.lower, certificate.upper), stop
        of_problem = (problem.k, problem.law, problem.sup1, problem.sup2)
        self._claim = (*certificate.parts[number], certificate.bound_V, *of_problem)

    def pieces(self) -> Iterator[_Piece]:
        """The pieces of the tree, one after another, which are seen to be the whole box.

        Raises
        ------
        CertificateError
            The file is no tree, or it is not whole.
        """
        lows, highs, top = walking.first_boxes(*self._box)
        counted = np.zeros(walking.COUNTED, np.int64)
        for data in chunks(self.path):
            boxes = lows[: top + 1].copy(), highs[: top + 1].copy()
            piece = _Piece(np.frombuffer(data, np.uint8), *boxes, int(counted[walking.LEAVES]))
            ended, top, _ = self._walk(False, piece.data, lows, highs, top, counted, no_tables())
            if ended != walking.GOING_ON:
                raise CertificateError(f"{self.path}: {_damage(ended, int(counted[walking.BOXES]))}")
            yield piece
        if top >= 0:
            raise CertificateError(f"{self.path}: its tree ends before its last box.")

    def check(self, piece: _Piece, tables: Tables) -> NDArray[np.int64]:
        """Check the leaves of a piece with tables for the part; what has been counted, see `walking`.

        Raises
        ------
        CertificateError
            The claim of a leaf could not be shown.
        """
        lows, highs, _ = walking.first_boxes(*self._box)
        lows[: len(piece.lows)], highs[: len(piece.highs)] = piece.lows, piece.highs
        counted = np.zeros(walking.COUNTED, np.int64)
        ended, _, box = self._walk(True, piece.data, lows, highs, len(piece.lows) - 1, counted, tables)
        if ended == walking.NOT_SHOWN:
            leaf = piece.leaves + int(counted[walking.LEAVES])
            names = ("U1", "−U2", "t1", "t2", "t3", "t4", "t5")
            sides = ", ".join(f"{name} {low:.9g}…{high:.9g}" for name, low, high in zip(names, *box, strict=True))
            text = f"the claim of leaf {leaf} of part {self.number} could not be shown, within its box {sides} (V, µs)."
            raise CertificateError(f"{self.path}: {text}")
        return counted

    def _walk(
        self, checks: bool, data: NDArray[np.uint8], lows: Array, highs: Array, top: int, counted: NDArray[np.int64],
        tables: Tables,
    ) -> tuple[int, int, Array]:  # fmt: skip
        """How a walk over some bytes ended, the index of the next box, and the box that could not be shown."""
        failed = np.empty((2, walking.SIDES))
        found: Any = walking.walk(
            checks, data, lows, highs, top, counted, *self._claim, tables, self._stop, failed, walking.memory()
        )
        return int(found[0]), int(found[1]), failed


def _damage(ended: int, box: int) -> str:
    """Why the walk over a part ended, as the end of a sentence."""
    if ended == walking.AFTER_END:
        return "something follows the end of its tree."
    if ended == walking.NO_SUCH_BYTE:
        return f"byte {box} is none of 0 to 7."
    if ended == walking.NO_WIDTH:
        return f"byte {box - 1} halves a side without width."
    return f"byte {box - 1} is deeper than {walking.DEEPEST} halvings."


def _table_maker(certificate: Certificate, problem: Problem, resolution: Resolution) -> TableMaker | None:
    """What fills the tables; None where no leaf is too wide for a bound without them, or they would take too much."""
    lower, upper = certificate.lower, certificate.upper
    if (upper[leaves.T5] - lower[leaves.T5]) / 2 <= leaves.COARSE_LAST_US:
        return None
    numbers = (problem.k, problem.law, problem.sup1, problem.sup2, float(problem.peak_V))
    return table_maker(*numbers, lower, upper, resolution)

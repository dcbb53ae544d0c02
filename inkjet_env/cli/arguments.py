"""Command-line arguments converted to printheads, costs and settings, or refused in one sentence.

Every function raises ``ValueError`` before any work is done.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from inkjet_env.printhead import DriverLimits, PeakCost
    from inkjet_env.typing import Real

CostGiven = tuple[float | None, float | None, str | None, float | None]


def chosen_cost(given: CostGiven, base: PeakCost | None = None) -> PeakCost:
    """``base`` with weights, effective rule and wanted height where given; a number as rule is a threshold in volts."""
    from inkjet_env.printhead import PeakCost

    A, B, effective, height_V = given
    base = base or PeakCost()
    rule: str | float = base.effective if effective is None else effective
    if effective is not None:
        try:
            rule = float(effective)
        except ValueError:
            rule = effective
    wanted_V = base.target_height_V if height_V is None else height_V
    return PeakCost(base.A if A is None else A, base.B if B is None else B, rule, wanted_V)


def chosen_seed(seed: int | None) -> int:
    """The seed; 0 if none is given."""
    if seed is not None and seed < 0:
        raise ValueError(f"--seed must be at least 0; got {seed}.")
    return seed or 0


def check_rate(sample_rate_Hz: float) -> None:
    """Raise ``ValueError`` if the sample rate does not suit edges of about a microsecond."""
    if not (math.isfinite(sample_rate_Hz) and 1e7 <= sample_rate_Hz <= 1e11):
        raise ValueError(
            f"--sample-rate must be 1e7 to 1e11 Hz, so that samples fall on every edge; got {sample_rate_Hz:g}."
        )


def check_outputs(inputs: Sequence[Path | None] = (), **files: Path | None) -> None:
    """Raise ``ValueError`` before any work if a result could not be written or would overwrite an input."""
    given = {name: path for name, path in files.items() if path is not None and str(path) != "-"}
    read = {os.path.realpath(path) for path in inputs if path is not None}
    for name, path in given.items():
        if os.path.realpath(path) in read:
            raise ValueError(f"--{name} {path} would overwrite an input file. Give another name.")
        if (path.exists() and not path.is_file()) or not _takes_files(Path(os.path.realpath(path)).parent):
            raise ValueError(f"--{name} {path}: {path.parent} must be a writable folder, and {path} a regular file.")
    if len({os.path.realpath(path) for path in given.values()}) < len(given):
        raise ValueError(f"--{' and --'.join(given)} must be different files.")
    for name in ("out", "plot"):
        if str(files.get(name)) == "-":
            raise ValueError(f'--{name} must be a file; only --json accepts "-".')
    if files.get("plot") is not None:
        from inkjet_env.reporting.plotting import check_picture_name

        check_picture_name(given["plot"])


def _takes_files(folder: Path) -> bool:
    """Whether a file can be created there. Permissions alone do not show a read-only medium, or apply to root."""
    try:
        with TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def drop_period_s(drop_frequency_Hz: float, shortest_s: float, what: str = "the waveform") -> float:
    """Firing period in seconds, if ``what`` of ``shortest_s`` seconds fits into it."""
    if not (math.isfinite(drop_frequency_Hz) and drop_frequency_Hz > 0):
        raise ValueError(f"--drop-frequency must be above 0 Hz; got {drop_frequency_Hz:g}.")
    if drop_frequency_Hz * shortest_s > 1 + 1e-9:
        raise ValueError(
            f"--drop-frequency {drop_frequency_Hz:g} Hz leaves {1e6 / drop_frequency_Hz:.4g} µs a drop; {what} "
            f"takes {1e6 * shortest_s:.4g} µs. Give at most {1 / shortest_s:.4g} Hz."
        )
    return 1 / drop_frequency_Hz


def chosen_limits(limits: str | None) -> DriverLimits:
    """The driver's limits; none unless given."""
    from inkjet_env.printhead import DriverLimits

    return DriverLimits.from_values({} if limits is None else named_values("--limits", limits))


def warn_of_limits(limits: DriverLimits, what: object, time_s: Real, drive_V: Real) -> None:
    """Print on standard error where a waveform exceeds a driver's limits."""
    for excess in limits.excesses(time_s, drive_V):
        print(f"warning: {what} {excess}", file=sys.stderr)


def named_values(option: str, text: str) -> dict[str, str]:
    """``name=value,name=value`` as a dict."""
    pairs = [part.partition("=") for part in text.split(",") if part.strip()]
    if not pairs or any(not name.strip() or not mark or not value.strip() for name, mark, value in pairs):
        raise ValueError(f"{option} must have the form name=value,name=value; got {text!r}.")
    return {name.strip(): value.strip() for name, _, value in pairs}

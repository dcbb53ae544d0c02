"""Command: ``python -m inkjet_env.experiments.bounds.verification FOLDER``."""

from __future__ import annotations

import argparse
import sys

from inkjet_env.experiments.bounds.verification.checking import Summary, check
from inkjet_env.experiments.bounds.verification.reading import CertificateError
from inkjet_env.progress import duration_text

REFUSED = 2
INTERRUPTED = 130


def told(summary: Summary) -> str:
    """What was verified, in words."""
    counts = (
        f"{summary.parts} of {summary.of_parts} parts, {summary.boxes} boxes, {summary.leaves} leaves, "
        f"{summary.divisions} further divisions, {duration_text(summary.taken_s)}"
    )
    if summary.whole:
        return f"Verified: no waveform of the problem costs less than {summary.bound_V:g} V. {counts}."
    return f"Verified this part only; the whole certificate is NOT verified by that. {counts}."


def main(arguments: list[str] | None = None) -> int:
    """Run the command; the exit status is 2 for a certificate that is refused, 130 after Ctrl-C."""
    parser = argparse.ArgumentParser(
        prog="python -m inkjet_env.experiments.bounds.verification",
        description="Verify a certificate that no waveform of a problem costs less than a bound.",
    )
    parser.add_argument("folder", help="folder of the certificate")
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="number of threads (default: 1)")
    parser.add_argument("--part", type=int, metavar="K", help="verify this part only, counted from 0")
    given = parser.parse_args(arguments)
    if given.workers < 1:
        parser.error("--workers: at least 1")
    try:
        summary = check(given.folder, given.workers, given.part)
    except CertificateError as error:
        print(error, file=sys.stderr)
        return REFUSED
    except KeyboardInterrupt:
        print("Interrupted; nothing is verified.", file=sys.stderr)
        return INTERRUPTED
    print(told(summary))
    return 0


if __name__ == "__main__":
    sys.exit(main())

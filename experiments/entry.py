"""The console script ``inkjet``: the complete command, or a sentence if the packages of the command are missing."""

from __future__ import annotations

import sys
from typing import NoReturn

from inkjet_env.extras import MissingExtraError, extra

BAD_INPUT = 2


def main() -> NoReturn:
    """Run the command; exit status 2 if typer is not installed."""
    try:
        with extra("inkjet"):
            from inkjet_env.experiments.cli import main as run
    except MissingExtraError as error:
        print(error, file=sys.stderr)
        sys.exit(BAD_INPUT)
    run()

"""The command ``inkjet``: the Typer application on which each command is registered, and its exit status.

Exit status: 0 done, 2 bad input (one sentence on standard error), 130 interrupted by Ctrl-C (finished work is kept).
Modules that are slow to import are imported by the command that needs them.
"""

from __future__ import annotations

import sys
from typing import Annotated, NoReturn

import typer

from inkjet_env.cli.campaigns import evaluate, identify, record
from inkjet_env.cli.diagnose import diagnose
from inkjet_env.cli.exit_status import BAD_INPUT, INTERRUPTED
from inkjet_env.cli.scan import scan
from inkjet_env.cli.simulate import simulate
from inkjet_env.extras import MissingExtraError, extra
from inkjet_env.interruption import treat_alike

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["--help", "-h"]},
)


def _print_version(asked: bool) -> None:
    if asked:
        from inkjet_env import __version__

        print(__version__)
        raise typer.Exit


@app.callback()
def _inkjet(
    version: Annotated[
        bool, typer.Option("--version", help="print the version and exit", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Record, identify, diagnose and simulate an inkjet printhead, optimise its waveform, compare optimisers.

    Units are SI (volts, seconds). Each command has its own --help with an example.
    """


for command, summary in (
    (simulate, "Simulate the response to a waveform or a sampled drive."),
    (scan, "Scan a waveform's pulse width, voltage, jetting frequency and robustness."),
    (record, "Record a campaign with the virtual rig."),
    (identify, "Identify a head from a campaign, with 90 % intervals."),
    (evaluate, "Compare a given printhead with a campaign."),
    (diagnose, "Find which physics the model lacks, and correct the model."),
):
    app.command(short_help=summary)(command)


def main(arguments: list[str] | None = None) -> NoReturn:
    """Run the command; report an error that the user can fix in one sentence, with exit status 2."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a terminal that cannot print µ must not stop the command
            stream.reconfigure(errors="replace")
    treat_alike()
    try:
        with extra("this command"):
            status = app(arguments, standalone_mode=False)
    except MissingExtraError as error:
        print(error, file=sys.stderr)
        sys.exit(BAD_INPUT)
    except (ValueError, OSError) as error:
        _refuse(_os_sentence(error) if isinstance(error, OSError) else str(error))
    except KeyboardInterrupt:
        print("Interrupted.", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except Exception as error:
        if not hasattr(error, "format_message"):  # only Typer's own usage errors have one
            raise
        if type(error).__name__ == "NoArgsIsHelpError":
            print(error.format_message())
            sys.exit(BAD_INPUT)
        _refuse(error.format_message())
    sys.exit(status or 0)


def _refuse(message: str) -> NoReturn:
    print(f"inkjet: {message}", file=sys.stderr)
    sys.exit(BAD_INPUT)


def _os_sentence(error: OSError) -> str:
    return f"{error.filename}: {error.strerror}." if error.filename else str(error)

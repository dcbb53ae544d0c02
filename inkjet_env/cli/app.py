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
from inkjet_env.cli.flags import with_options
from inkjet_env.cli.scan import scan
from inkjet_env.cli.simulate import simulate
from inkjet_env.extras import MissingExtraError, extra
from inkjet_env.interruption import treat_alike

FIRST_STEPS = """\
Four commands to begin with. They need no file and no instrument; paste them one
after another in an empty folder:

  inkjet simulate --waveform 100 -100 1e-6 10.49e-6 13.74e-6 9.81e-6 19.96e-6
      fires one waveform at the published head: its peaks, cost and ringing

  inkjet record campaign --hide second_mode
      records a virtual head that has more physics than the model

  inkjet diagnose campaign --printhead-out corrected.json
      finds what the model lacks and corrects it (one or two minutes)

  inkjet optimize --printhead corrected.json --out waveform.csv
      finds the waveform with the lowest cost for that head

All commands: inkjet --help. All options of one, and examples:
inkjet COMMAND --help."""
"""What ``inkjet`` alone prints: from one waveform to a head's own, each step with what the one before left."""

app = typer.Typer(
    add_completion=False,
    invoke_without_command=True,
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
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", help="print the version and exit", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Record, identify, diagnose and simulate an inkjet printhead, optimise its waveform, compare optimisers.

    Units are SI (volts, seconds). Each command has its own --help with examples.
    """
    if context.invoked_subcommand is None:
        print(FIRST_STEPS)
        raise typer.Exit(BAD_INPUT)


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
    except OSError as error:
        _refuse(_os_sentence(error))
    except ValueError as error:
        _refuse(with_options(str(error), _options_of(sys.argv[1:] if arguments is None else arguments)))
    except KeyboardInterrupt:
        print("Interrupted.", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except Exception as error:
        if not hasattr(error, "format_message"):  # only Typer's own usage errors have one
            raise
        _refuse(error.format_message())
    sys.exit(status or 0)


def _options_of(arguments: list[str]) -> set[str]:
    """All options of the command that is named on a command line."""
    commands = getattr(typer.main.get_command(app), "commands", {})
    named = next((commands[word] for word in arguments if word in commands), None)
    return set() if named is None else {option for parameter in named.params for option in parameter.opts}


def _refuse(message: str) -> NoReturn:
    print(f"inkjet: {message}", file=sys.stderr)
    sys.exit(BAD_INPUT)


def _os_sentence(error: OSError) -> str:
    return f"{error.filename}: {error.strerror}." if error.filename else str(error)

"""Errors of the Python functions behind a command, in the command's own words: its options in place of arguments."""

from __future__ import annotations

import re
from collections.abc import Container

ARGUMENTS = {
    "A": "--cost-a",
    "B": "--cost-b",
    "vary": "--vary",
    "risk": "--robust",
    "held_out": "--held-out",
    "jetting_Hz": "--drop-frequency",
}
"""Options whose names do not follow from those of the arguments."""
UNIT = re.compile(r"_(?:V|s|Hz|dB)$")
FIRST = re.compile(r"^([A-Za-z_]+)(?= must )")
CALLED = re.compile(r"\b([a-z_]+)=(?:(\{[^}]*\})|True)?(?: \(--[^)]*\))?(?![\w'\"=])")
"""An argument as Python takes it: ``channel=``, ``columns={'drive': …}``, ``implausible=True (--implausible)``."""


def option_of(argument: str) -> str:
    """The option of a Python argument.

    Examples
    --------
    >>> option_of("initial_state"), option_of("window_s"), option_of("snr_dB"), option_of("A")
    ('--initial-state', '--window', '--snr-db', '--cost-a')
    """
    if argument == "snr_dB":
        return "--snr-db"  # without its unit nobody would know what it is
    return ARGUMENTS.get(argument) or f"--{UNIT.sub('', argument).replace('_', '-')}"


def with_options(message: str, options: Container[str]) -> str:
    """A message with a command's options in place of the arguments of the functions behind it.

    Parameters
    ----------
    message : str
        An error's sentence. Arguments are recognised where it begins with one that "must" be something, and where it
        says how to give one in Python.
    options : container of str
        The command's options; what is none of them is left as it is.

    Examples
    --------
    >>> with_options("window_s must be a time above 0 s; got 0.0.", {"--window"})
    '--window must be a time above 0 s; got 0.0.'
    >>> with_options("a.csv: the sensor is unknown. Give channel=.", {"--channel"})
    'a.csv: the sensor is unknown. Give --channel.'
    >>> with_options("Specify them with columns={'drive': …, 'sensor': …} (--columns).", {"--columns"})
    'Specify them with --columns drive=…,sensor=….'
    >>> with_options("head.json: window_s must be above 0 s.", {"--window"})
    'head.json: window_s must be above 0 s.'
    """

    def first(found: re.Match[str]) -> str:
        option = option_of(found[1])
        return option if option in options else found[0]

    def called(found: re.Match[str]) -> str:
        option = option_of(found[1])
        if option not in options:
            return found[0]
        pairs = re.findall(r"'(\w+)': ([^,}]+)", found[2] or "")
        return option + (" " + ",".join(f"{name}={value.strip()}" for name, value in pairs) if pairs else "")

    return CALLED.sub(called, FIRST.sub(first, message))

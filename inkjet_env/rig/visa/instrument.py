"""One instrument over VISA: commands, questions and their errors in sentences."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkjet_env.extras import extra

MOST_ERRORS = 20
"""Most errors that are read at once; an instrument that does not know the question may have no last one."""


class InstrumentError(ValueError):
    """An instrument that cannot be reached, reports an error, or answers what cannot be used."""


class NoAnswerError(InstrumentError):
    """An instrument that does not answer in time."""


class Instrument:
    """An open connection to an instrument.

    Parameters
    ----------
    address : str
        VISA address, such as ``TCPIP::192.168.0.10::INSTR``.
    role : str
        What it is, in words.
    library : str
        VISA library, as in PyVISA: empty for the installed one, ``@py`` for PyVISA-py, ``FILE.yaml@sim`` for simulated
        instruments.
    timeout_s : float
        Longest time that it may take to answer, in seconds.
    error_query : str
        Question for the oldest error.

    Raises
    ------
    InstrumentError
        There is no VISA library, or no such instrument.
    MissingExtraError
        PyVISA is not installed.
    """

    def __init__(self, address: str, role: str, library: str, timeout_s: float, error_query: str) -> None:
        with extra("a rig over VISA"):
            import pyvisa
        self.name, self.timeout_s, self._error_query = f"the {role} {address}", timeout_s, error_query
        try:
            self._manager = pyvisa.ResourceManager(library)
        except (OSError, ValueError) as error:
            told = str(error).replace("\\n", "\n").replace("\\'", "'")  # it may hold the repr of a traceback
            last = [line.strip(" .") for line in told.splitlines() if line.strip(" .'")][-1:]
            raise InstrumentError(
                f"the VISA library {library or '(the default one)'} cannot be used: {''.join(last)}. Correct its name, "
                "or install PyVISA-py and give library='@py'."
            ) from None
        with self._told("cannot be opened", timeout_s):
            self._resource: Any = self._manager.open_resource(address)
        if not isinstance(self._resource, pyvisa.resources.MessageBasedResource):
            raise InstrumentError(
                f"{self.name} takes no commands. Give its address as the VISA library lists it, such as "
                "'TCPIP::192.168.0.10::INSTR'."
            )
        self._resource.timeout, self._resource.write_termination = 1000 * timeout_s, "\n"
        if address.upper().endswith("::SOCKET") or address.upper().startswith("ASRL"):
            self._resource.read_termination = "\n"  # nothing else marks an end there, nor is there a way to clear it
            return
        with self._told("cannot be cleared", timeout_s), suppress(NotImplementedError):  # as by simulated ones
            self._resource.clear()  # a recording that still waits for its trigger, or an answer that nobody read

    def send(self, command: str, checked: bool = True) -> None:
        """Send a command.

        Parameters
        ----------
        command : str
            The command.
        checked : bool
            Whether to ask for errors afterwards.
        """
        with self._told(f"does not take {_brief(command)}", self.timeout_s):
            self._resource.write(command)
        if checked:
            self.check(command)

    def ask(self, question: str, timeout_s: float | None = None) -> str:
        """Answer to a question, without its end of line; ``timeout_s`` replaces that of the connection."""
        timeout_s = self.timeout_s if timeout_s is None else timeout_s
        with self._told(f"does not answer {_brief(question)}", timeout_s):
            self._resource.timeout = 1000 * timeout_s
            try:
                answer = str(self._resource.query(question)).strip()
            finally:
                self._resource.timeout = 1000 * self.timeout_s
        if not answer:
            raise InstrumentError(f"{self.name} answers {_brief(question)} with nothing. Is the address right?")
        return answer

    def numbers(self, question: str, count: int) -> list[float]:
        """Answer to a question: at least ``count`` numbers with commas between them."""
        answer = self.ask(question)
        try:
            found = [float(part) for part in answer.split(",")]
        except ValueError:
            found = []
        if len(found) < count:
            raise InstrumentError(
                f"{self.name} answers {_brief(question)} with {_brief(answer)}, not with {count} numbers. Adapt the "
                "commands to it."
            )
        return found

    def words(self, question: str, big_endian: bool) -> NDArray[np.float64]:
        """Answer to a question: a block of unsigned 16-bit numbers, shape (n,)."""
        with self._told(f"does not answer {_brief(question)} with samples", self.timeout_s):
            found = self._resource.query_binary_values(question, "H", big_endian, np.array)
        return np.asarray(found, dtype=np.float64)

    def check(self, command: str) -> None:
        """Raise `InstrumentError` if the instrument has errors to report, after a command."""
        told: list[str] = []
        while len(told) < MOST_ERRORS and not (answer := self.ask(self._error_query)).lstrip("+-").startswith("0"):
            told.append(answer)
        if told:
            raise InstrumentError(
                f"{self.name} reports after {_brief(command)}: {'; '.join(told[:3])}. If it is of another maker, adapt "
                "the commands to it."
            )

    def close(self) -> None:
        """Close the connection."""
        self._resource.close()

    @contextmanager
    def _told(self, what: str, timeout_s: float) -> Iterator[None]:
        """PyVISA's errors as sentences."""
        from pyvisa.constants import StatusCode
        from pyvisa.errors import Error, VisaIOError

        try:
            yield
        except VisaIOError as error:
            if error.error_code == StatusCode.error_timeout:
                raise NoAnswerError(f"{self.name} {what} within {timeout_s:.3g} s.") from None
            raise InstrumentError(f"{self.name} {what}: {error.description}") from None
        except (Error, OSError, ValueError) as error:  # a name that is no address, a block without a header
            raise InstrumentError(f"{self.name} {what}: {error}") from None


def _brief(text: str) -> str:
    """A command in quotation marks, shortened to fit into a message."""
    return f"'{text}'" if len(text) <= 60 else f"'{text[:57]}…'"

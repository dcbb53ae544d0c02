"""Greenlets in place of nevergrad's threads: some of its optimisers run a library's own loop in a thread.

Such a thread draws from NumPy's process-wide generator whenever it happens to be scheduled, so no seed makes its run
repeatable, and a thread that is left waiting keeps the process from ending. A greenlet does the same work in turn.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest import mock

from cma.options_parameters import cma_default_options
from greenlet import getcurrent, greenlet
from nevergrad.optimization import recaster


class Conversation:
    """Replacement for `nevergrad.optimization.recaster.MessagingThread`: runs ``caller(fake_objective)`` in turns."""

    def __init__(self, caller: Callable[..., Any]) -> None:
        self._library = greenlet(lambda: caller(self._ask_outside))
        self._asked: deque[Any] = deque()
        self._told: deque[Any] = deque()
        self.output: Any = None
        self.error: Exception | None = None
        self.messages_tell = _Door(put=self._told.append)
        self.messages_ask = _Door(get=self._next_asked)

    def is_alive(self) -> bool:
        """Whether the library is still running."""
        return not self._library.dead

    def stop(self) -> None:
        """Do nothing: a greenlet ends with the last reference to it."""

    def _ask_outside(self, *arguments: Any) -> Any:
        self._asked.append(arguments[0])
        return getcurrent().parent.switch()

    def _next_asked(self) -> Any:
        """The library's next request after it has received all costs; None, or its exception, if it has ended."""
        if not self._library and not self._library.dead:
            self._resume()
        while self._told and not self._library.dead:
            self._resume(self._told.popleft())
        if not self._asked:
            raise RuntimeError("nevergrad asks for a second point before it has received the first one's cost.")
        return self._asked.popleft()

    def _resume(self, *answer: Any) -> None:
        self._library.parent = getcurrent()
        try:
            output = self._library.switch(*answer)
        except Exception as error:
            self.error = error
            self._asked.append(error)
        else:
            if self._library.dead:
                self.output = output
                self._asked.append(None)


class _Door:
    """One end of a queue."""

    def __init__(self, **ways: Callable[..., Any]) -> None:
        vars(self).update(ways)


@contextmanager
def repeatable_nevergrad() -> Iterator[None]:
    """Within this context nevergrad starts no threads, and pycma inside it draws from NumPy's generator as it is.

    (By default pycma reseeds that generator from the clock.)
    """
    with (
        mock.patch.object(recaster, "MessagingThread", Conversation),
        mock.patch.dict(cma_default_options, {"seed": float("nan")}),
    ):
        yield

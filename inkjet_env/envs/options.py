"""Names of the environments' options: an unknown one is told with the nearest and the list."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from typing import Any

import gymnasium

from inkjet_env.envs.task import make_task
from inkjet_env.naming import nearest_name


class UnknownOptionError(TypeError, ValueError):
    """An environment was given an option that it does not have.

    It is a ``TypeError`` as well, with Python's words for an unknown keyword: TorchRL tries options of other
    environments, and takes them back at that.
    """


def check_option_names(constructor: Callable[..., Any], options: Iterable[str], fixed: Iterable[str] = ()) -> None:
    """Raise `UnknownOptionError` for an option that neither the environment's constructor nor its task has.

    Parameters
    ----------
    constructor : callable
        The environment's ``__init__``, whose remaining keyword arguments go to `inkjet_env.envs.task.make_task`.
    options : iterable of str
        Names of these remaining arguments.
    fixed : iterable of str
        Arguments of `make_task` that the environment does not offer.
    """
    own, of_task = _arguments(constructor), _arguments(make_task)
    known = [*own, *(name for name in of_task if name not in {*fixed, *own})]
    of_gymnasium = {*_arguments(gymnasium.make), *_arguments(gymnasium.make_vec)} - {"id"}
    for name in options:
        if name not in known:
            nearest = nearest_name(name, [*known, *sorted(of_gymnasium - {name})])
            raise UnknownOptionError(
                f"unexpected keyword argument {name!r}: the environment has no option of this name.{nearest} "
                f"Its options are {', '.join(known)}."
            )


def _arguments(function: Callable[..., Any]) -> list[str]:
    given = inspect.signature(function).parameters.values()
    return [one.name for one in given if one.kind is not one.VAR_KEYWORD and one.name != "self"]

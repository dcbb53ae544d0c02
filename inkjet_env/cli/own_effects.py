"""``--effect module:Class``: a user's own effect, imported from the module that the user names."""

from __future__ import annotations

import importlib
import os
import sys
import traceback
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from inkjet_env.plant import Effect


def register_own(named: Sequence[str] | None) -> tuple[Effect, ...]:
    """Import and register the classes that ``--effect`` names; return one instance of each.

    The current folder is searched after the installed packages.

    Raises
    ------
    ValueError
        There is no such module or class, the module's import fails, or `register` refuses the class.
    """
    if not named:
        return ()
    from inkjet_env.plant import register

    if not {"", os.getcwd()} & set(sys.path):
        sys.path.append(os.getcwd())
    effects = []
    for name in dict.fromkeys(named):
        try:
            effects.append(register(_class(name))())
        except ValueError as error:
            raise ValueError(f"--effect {name}: {error}") from None
    return tuple(effects)


def _class(name: str) -> Any:
    """The object at ``module:Class``."""
    module, mark, path = name.partition(":")
    if not (module and mark and path):
        raise ValueError(
            "must have the form module:Class, such as my_effects:QuadraticStiffness for the file my_effects.py."
        )
    found: Any = _module(module)
    for part in path.split("."):
        if not hasattr(found, part):
            raise ValueError(_no_such_class(module, path))
        found = getattr(found, part)
    return found


def _module(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{name}.".startswith(f"{error.name}."):
            raise ValueError(_failed(name, error)) from None
        raise ValueError(
            f"there is no module {name} in {os.getcwd()} or among the installed packages. Give the name of a file "
            "without .py, and run the command in its folder."
        ) from None
    except (Exception, SystemExit) as error:
        raise ValueError(_failed(name, error)) from None


def _failed(module: str, error: BaseException) -> str:
    """An error in the user's module, with its own message and its file and line."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    where = "" if isinstance(error, SyntaxError) else f" ({last.filename}, line {last.lineno})"
    return f"the module {module} cannot be imported: {type(error).__name__}: {error}{where}"


def _no_such_class(module: str, path: str) -> str:
    from inkjet_env.naming import nearest_name
    from inkjet_env.plant import Effect

    found = sys.modules[module]
    effects = [
        name
        for name, value in vars(found).items()
        if isinstance(value, type) and issubclass(value, Effect) and value is not Effect
    ]
    file = getattr(found, "__file__", None) or module
    has = f"its effects are {', '.join(effects)}" if effects else "it has no effect"
    return f"there is no {path} in {file}; {has}.{nearest_name(path, effects)}"

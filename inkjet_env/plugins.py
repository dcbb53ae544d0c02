"""Optimisers, problems and effects of other packages: by the name of an entry point, or as ``module:Class``.

A package offers them in its ``pyproject.toml``::

    [project.entry-points."inkjet_env.optimizers"]
    annealing = "my_lab.search:Annealing"

    [project.entry-points."inkjet_env.problems"]
    tall-drop = "my_lab.heads:tall_drop"

    [project.entry-points."inkjet_env.effects"]
    quadratic_stiffness = "my_lab.physics:QuadraticStiffness"

``module:Class`` needs no package: the current folder is searched after the installed packages. Code is imported only
if the user names it on the command line or asks for all that is installed; reading a file never imports any.
"""

from __future__ import annotations

import functools
import importlib
import os
import sys
import traceback
from collections.abc import Iterable
from dataclasses import dataclass
from hashlib import sha256
from importlib.metadata import entry_points, packages_distributions, version
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

OPTIMIZERS, PROBLEMS, EFFECTS = "inkjet_env.optimizers", "inkjet_env.problems", "inkjet_env.effects"
"""Groups of entry points."""


@dataclass(frozen=True)
class Plugin:
    """Something that another package or a user's file provides.

    Attributes
    ----------
    name : str
        The name by which the user asks for it.
    place : str
        ``module:Class``.
    """

    name: str
    place: str

    def load(self) -> Any:
        """Import it.

        Raises
        ------
        ValueError
            There is no such module or class, or the module's import fails.
        """
        module, _, path = self.place.partition(":")
        found = _imported(module)
        for part in path.split("."):
            if not hasattr(found, part):
                raise ValueError(_no_such_object(module, path))
            found = getattr(found, part)
        return found

    def provenance(self) -> dict[str, str]:
        """Where it comes from: its place, a digest of its code, and the version of its package.

        The digest is over the Python files of the packages, or over the single files, that hold the module and the
        class with its parents, as they were when this process asked first: later changes do not change the code that
        was imported.
        """
        found = self.load()
        return provenance(found if isinstance(found, type) else type(found), self.place)


def provenance(kind: type, place: str | None = None) -> dict[str, str]:
    """Place, code and package of a class, as in `Plugin.provenance`, or of an object of that class at another place."""
    return dict(_provenance(kind, place or f"{kind.__module__}:{kind.__qualname__}"))


def is_place(name: str) -> bool:
    """Whether a name has the form ``module:Class``."""
    return ":" in name


def plugin(group: str, name: str, ours: Iterable[str] = ()) -> Plugin | None:
    """The plug-in of a group with a name, or at a place ``module:Class``; None if there is none with that name.

    Parameters
    ----------
    group : str
        One of `OPTIMIZERS`, `PROBLEMS` and `EFFECTS`.
    name : str
        Name of an entry point, or ``module:Class``.
    ours : iterable of str
        Names that this package itself has in the group, which no entry point may take.

    Raises
    ------
    ValueError
        The place is incomplete, or an installed package takes a name that is taken.
    """
    if not is_place(name):
        return installed(group, ours).get(name)
    module, _, path = name.partition(":")
    if not (module and path):
        raise ValueError("must have the form module:Class, such as my_lab:Annealing for the file my_lab.py.")
    if not {"", os.getcwd()} & set(sys.path):
        sys.path.append(os.getcwd())
    return Plugin(name, name)


def installed(group: str, ours: Iterable[str] = ()) -> dict[str, Plugin]:
    """The plug-ins that installed packages offer in a group, by name; see `plugin`."""
    found: dict[str, Plugin] = {}
    reserved = set(ours)
    for point in sorted(entry_points(group=group), key=lambda point: point.name):
        package = point.dist.name if point.dist else point.value
        same = found.get(point.name)
        if point.name in reserved or (same is not None and same.place != point.value):
            taken_by = "this package" if same is None else same.place
            raise ValueError(
                f"the package {package} offers {point.name!r} in the group {group}, but {taken_by} has that name. "
                f"Uninstall one of them, or ask {package} for another name."
            )
        found[point.name] = Plugin(point.name, point.value)
    return found


@functools.cache
def _provenance(kind: type, place: str) -> dict[str, str]:
    modules = [place.partition(":")[0], *(parent.__module__ for parent in kind.__mro__)]
    total, packages = sha256(), set[str]()
    for name in dict.fromkeys(modules):
        top = name.partition(".")[0]
        if top in sys.stdlib_module_names or top == __package__:
            continue
        module = sys.modules.get(top)
        if getattr(module, "__file__", None) is None:  # a namespace that several packages share
            module = sys.modules.get(name)
        file = Path(getattr(module, "__file__", None) or "")
        if not file.is_file():
            return {"place": place, "code": "typed at a console or in a notebook", "package": "none"}
        for one in sorted(file.parent.rglob("*.py")) if file.name == "__init__.py" else [file]:
            total.update(f"{one.relative_to(file.parent)}\0{sha256(one.read_bytes()).hexdigest()}\0".encode())
        packages |= {f"{package} {version(package)}" for package in packages_distributions().get(top, [])}
    return {"place": place, "code": total.hexdigest(), "package": ", ".join(sorted(packages)) or "none"}


def _imported(name: str) -> Any:
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
    where = "" if isinstance(error, SyntaxError) else place_of(error)
    return f"the module {module} cannot be imported: {type(error).__name__}: {error}{where}"


def place_of(error: BaseException) -> str:
    """File and line at which an error was raised, in parentheses."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f" ({last.filename}, line {last.lineno})"


def _no_such_object(module: str, path: str) -> str:
    from inkjet_env.naming import nearest_name

    found = sys.modules[module]
    own = [name for name, value in vars(found).items() if name[0] != "_" and _home(value, module) == module]
    file = getattr(found, "__file__", None) or module
    has = f"it defines {', '.join(own)}" if own else "it defines nothing of its own"
    hidden = Path(f"{module}.py").resolve()
    if hidden.is_file() and hidden != Path(file).resolve():
        return f"there is no {path} in {file}, which hides your {hidden.name}. Rename your file."
    return f"there is no {path} in {file}; {has}.{nearest_name(path, own)}"


def _home(value: Any, module: str) -> str | None:
    """Module that defines a class or a function; for any other object ``module``, in which it was found."""
    if isinstance(value, ModuleType):
        return None
    return value.__module__ if isinstance(value, (type, FunctionType)) else module

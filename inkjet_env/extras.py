"""Packages that come with an extra of this one, and the sentence said where one of them is missing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

BENCH = ("cma", "nevergrad", "pymoo", "optuna", "pandas", "plotly", "greenlet", "pyarrow", "jinja2", "matplotlib")
"""Packages that a comparison of optimisers needs."""


class MissingExtraError(ImportError):
    """A package is needed that is not installed; the message says how to install it.

    Parameters
    ----------
    what : str
        What needs the package, in words.
    package : str
        Name of the package.
    extra : str
        Extra of inkjet-env that installs it.
    """

    def __init__(self, what: str, package: str, extra: str) -> None:
        super().__init__(
            f"{what} needs {package}, which is not installed: pip install 'inkjet-env[{extra}]'", name=package
        )


@contextmanager
def extra(name: str, what: str) -> Iterator[None]:
    """Context for imports of an extra's packages by ``what``; `MissingExtraError` if one of them is not installed.

    Examples
    --------
    >>> with extra("cli", "a figure"):
    ...     import nosuch
    Traceback (most recent call last):
        ...
    inkjet_env.extras.MissingExtraError: a figure needs nosuch, which is not installed: pip install 'inkjet-env[cli]'
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "a package").partition(".")[0]
        if package == "inkjet_env":
            raise
        raise MissingExtraError(what, package, name) from None


def check_installed(name: str, what: str, packages: tuple[str, ...]) -> None:
    """Raise `MissingExtraError` for the first of an extra's packages that is not installed; imports none."""
    for package in packages:
        if find_spec(package) is None:
            raise MissingExtraError(what, package, name)

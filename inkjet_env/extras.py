"""Packages that come with an extra of this one, and the sentence said where one of them is missing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

PACKAGES = {
    "cli": ("typer", "rich", "matplotlib", "jinja2", "pyarrow", "joblib", "bokeh"),
    "bench": ("cma", "nevergrad", "pymoo", "optuna", "pandas", "greenlet"),
    "explore": ("panel", "bokeh"),
    "hdf5": ("h5py",),
    "visa": ("pyvisa", "pyvisa_sim"),
    "rl": ("torch", "stable_baselines3"),
    "jax": ("jax",),
    "cluster": ("distributed", "dask"),
    "human": ("pygame", "matplotlib"),
    "dev": ("pytest", "pysindy", "mpmath", "playwright", "ioh"),
}
"""Packages that each extra brings, by the names they are imported by."""


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
def extra(what: str) -> Iterator[None]:
    """Context or decorator of imports for ``what``; `MissingExtraError` if an extra's package is not installed.

    Examples
    --------
    >>> with extra("learning"):
    ...     raise ModuleNotFoundError(name="torch.nn")
    Traceback (most recent call last):
        ...
    inkjet_env.extras.MissingExtraError: learning needs torch, which is not installed: pip install 'inkjet-env[rl]'
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        for name, packages in PACKAGES.items():
            if package in packages:
                raise MissingExtraError(what, package, name) from None
        raise


def check_installed(what: str, *names: str) -> None:
    """Raise `MissingExtraError` for the first package of these extras that is not installed; imports none."""
    for name in names:
        for package in PACKAGES[name]:
            if find_spec(package) is None:
                raise MissingExtraError(what, package, name)

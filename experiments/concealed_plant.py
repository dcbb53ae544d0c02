"""The concealed plant, to import wherever this package is installed.

    >>> from inkjet_env.experiments.concealed_plant import Case, build

The files of the plant are frozen, because published proofs commit to their bytes, and they import each other as
``experiments.concealed_rig``. That name may belong to the user, so it leads to our folder only while they are loaded.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

RIG = "experiments.concealed_rig"
"""Module of the plant, as its own files, proofs and their settings name it."""


def import_rig(name: str = RIG) -> Any:
    """Import a module of the concealed plant, or another plant that takes its place.

    Parameters
    ----------
    name : str
        Name of the module: `RIG`, a module in it, or any other module.
    """
    if name != RIG and not name.startswith(f"{RIG}."):
        return import_module(name)
    top = RIG.partition(".")[0]
    theirs = sys.modules.get(top)
    sys.modules[top] = sys.modules[__package__]
    try:
        return import_module(name)
    finally:
        del sys.modules[top]
        if theirs is not None:
            sys.modules[top] = theirs


if TYPE_CHECKING:
    from inkjet_env.experiments.concealed_rig import Case, build
else:
    rig = import_rig()
    Case, build = rig.Case, rig.build

__all__ = ["RIG", "Case", "build", "import_rig"]

"""The code that an effect runs: the files that hold it, or the code itself if typed at a console or in a notebook."""

from __future__ import annotations

import hashlib
import inspect
import sys
from collections.abc import Iterator, Mapping
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from inkjet_env.plant import Effect

SHELL = {"__dict__", "__weakref__", "__module__", "__doc__", "__abstractmethods__", "_abc_impl"}
"""Attributes that every class has and that say nothing about what it does."""


def source_files(effect: Effect) -> set[str]:
    """Paths of the modules from which an effect's class and its parents were imported."""
    modules = [sys.modules[parent.__module__] for parent in type(effect).__mro__ if _imported(parent)]
    return {file for module in modules if (file := getattr(module, "__file__", None)) is not None}


def code_digest(effect: Effect) -> bytes:
    """Digest of an effect's attributes, and of its class and those parents that were not imported from a module.

    It covers attributes, the instructions and constants of methods, and the global names that these use. It changes
    with any of them and is the same in every process of one Python version.
    """
    sha = hashlib.sha256()
    typed = [parent for parent in type(effect).__mro__ if not _imported(parent)]
    for text in _described([vars(effect), typed], set()):
        part = text.encode()
        sha.update(len(part).to_bytes(8, "little"))
        sha.update(part)
    return sha.digest()


def _imported(thing: type | FunctionType) -> bool:
    """Whether a class or a function comes from an imported module, not from a console, a notebook or a script."""
    module = sys.modules.get(thing.__module__ or "")
    return module is not None and thing.__module__ != "__main__" and module.__spec__ is not None


def _described(value: Any, seen: set[int]) -> Iterator[str]:
    """Texts that differ where values do; ``seen`` holds the ids of what has been described already."""
    inner = inspect.unwrap(value) if callable(value) else value
    if isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.shape} {value.tobytes().hex()}"
    elif isinstance(value, ModuleType):
        yield value.__name__
    elif isinstance(value, Mapping):
        for key in sorted(value, key=repr):
            yield repr(key)
            yield from _described(value[key], seen)
    elif isinstance(value, (tuple, list)):
        yield f"{len(value)} in order"
        for entry in value:
            yield from _described(entry, seen)
    elif isinstance(value, (set, frozenset)):
        yield f"{len(value)} in no order"
        yield from sorted("\0".join(_described(entry, set(seen))) for entry in value)
    elif isinstance(value, CodeType):
        yield value.co_code.hex()
        yield from _described((value.co_names, value.co_varnames, value.co_freevars, value.co_consts), seen)
    elif isinstance(value, property):
        yield from _described((value.fget, value.fset), seen)
    elif isinstance(inner, (type, FunctionType)):
        yield f"{inner.__module__}.{inner.__qualname__}"
        if not _imported(inner) and id(inner) not in seen:
            seen.add(id(inner))
            yield from _described(_of_class(inner) if isinstance(inner, type) else _of_function(inner), seen)
    elif getattr(value, "__dict__", None):
        yield type(value).__qualname__
        if id(value) not in seen:
            seen.add(id(value))
            yield from _described([type(value), vars(value)], seen)
    else:
        yield type(value).__qualname__ if type(value).__repr__ is object.__repr__ else repr(value)


def _of_class(cls: type) -> list[Any]:
    return [*cls.__bases__, {name: value for name, value in vars(cls).items() if name not in SHELL}]


def _of_function(function: FunctionType) -> list[Any]:
    """A function's code, defaults, closure, and the global names that it or a function inside it uses."""
    names, codes = set[str](), [function.__code__]
    while codes:
        code = codes.pop()
        names |= set(code.co_names)
        codes += [constant for constant in code.co_consts if isinstance(constant, CodeType)]
    used = {name: function.__globals__[name] for name in sorted(names) if name in function.__globals__}
    cells = function.__closure__ or ()
    return [function.__code__, function.__defaults__, function.__kwdefaults__, [c.cell_contents for c in cells], used]

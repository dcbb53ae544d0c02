"""A user's own effects: classes beside the catalogue, registered in this process.

A printhead.json names the class of such an effect as ``module:Class`` and can be read only where that class is
registered: reading a file never imports code.
"""

from __future__ import annotations

from inkjet_env.naming import check_name
from inkjet_env.plant.effect import STAGES, Effect
from inkjet_env.plant.effects import catalogue

_registered: dict[str, Effect] = {}


class UnregisteredEffectError(ValueError):
    """A file has an effect of a class that is not registered in this process."""


def register(kind: type[Effect]) -> type[Effect]:
    """Register the class of an effect of your own, so that a printhead.json with this effect can be read::

        from inkjet_env.plant import register
        from my_effects import QuadraticStiffness

        register(QuadraticStiffness)

    The registration holds for this process and those forked from it; a process that is started afresh, such as a worker
    under "spawn", must register for itself. A class that is defined again, as when a notebook cell is rerun, replaces
    the former one.

    Parameters
    ----------
    kind : type
        Subclass of `Effect` whose constructor takes no arguments.

    Returns
    -------
    type
        The same class, so that ``@register`` can decorate it.

    Raises
    ------
    ValueError
        ``kind`` is not such a class, lacks a declaration that an effect needs, or has an id of the catalogue or of
        another registered class.
    """
    if not (isinstance(kind, type) and issubclass(kind, Effect)) or kind is Effect:
        raise ValueError(f"an effect must be a subclass of inkjet_env.plant.Effect; got {kind!r}.")
    name = class_name(kind)
    if missing := [attribute for attribute in Effect.__annotations__ if not hasattr(kind, attribute)]:
        raise ValueError(f"{name} must declare {', '.join(missing)}, as inkjet_env.plant.Effect describes them.")
    check_name(f"stage of {name}", kind.stage, STAGES)
    if kind.id in {effect.id for effect in catalogue()}:
        raise ValueError(f"{name} has the id {kind.id!r} of an effect in the catalogue. Give it a unique id.")
    before = _registered.get(kind.id)
    if before is not None and class_name(type(before)) != name:
        raise ValueError(
            f"{name} has the id {kind.id!r}, under which {class_name(type(before))} is registered. Give it an id of "
            "its own."
        )
    try:
        _registered[kind.id] = kind()
    except Exception as error:
        raise ValueError(f"{name} cannot be made without arguments: {type(error).__name__}: {error}") from error
    return kind


def known_effects() -> tuple[Effect, ...]:
    """Every effect of the catalogue, then those registered in this process."""
    return (*catalogue(), *_registered.values())


def own_class(effect: Effect) -> str | None:
    """``module:Class`` of a user's own effect; None for an effect of the catalogue."""
    return None if type(effect) in map(type, catalogue()) else class_name(type(effect))


def class_name(kind: type[Effect]) -> str:
    """``module:Class`` of a class; the module of a console, a notebook or a script is ``__main__``."""
    return f"{kind.__module__}:{kind.__qualname__}"


def registered_effect(effect_id: str, named: str) -> Effect:
    """The registered effect with an id, provided that its class is the ``named`` one.

    Parameters
    ----------
    effect_id : str
        Id of the effect.
    named : str
        ``module:Class``, as it stands in the file.

    Returns
    -------
    Effect
        The registered effect.

    Raises
    ------
    UnregisteredEffectError
        No class is registered under this id, or another one is.
    """
    effect = _registered.get(effect_id)
    if effect is None:
        raise UnregisteredEffectError(
            f"effect {effect_id!r} is of the class {named}, which is not registered here; reading a file never "
            f"imports code. {_how_to_register(named)}"
        )
    if class_name(type(effect)) != named:
        raise UnregisteredEffectError(
            f"effect {effect_id!r} is of the class {named}, but the class registered under this id is "
            f"{class_name(type(effect))}. Register the one that the file names, or write the file again with the other."
        )
    return effect


def _how_to_register(named: str) -> str:
    module, _, path = named.partition(":")
    if module == "__main__" or "<" in path:
        return (
            f"It was defined at a console, in a notebook, a script or a function: define it there again and call "
            f"inkjet_env.plant.register({path.rpartition('.')[2]}). For the command line, move it into a module and "
            "write the file again."
        )
    return (
        f'If you trust it, register it: in Python "from {module} import {path.partition(".")[0]}; '
        f'inkjet_env.plant.register({path})", on the command line "--effect {named}".'
    )

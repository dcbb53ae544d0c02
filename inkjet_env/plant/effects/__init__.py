"""The catalogue: one file per effect. Every effect in this folder is in the catalogue; nothing else lists it."""

from __future__ import annotations

import functools
import importlib
import pkgutil

from inkjet_env.plant.effect import STAGES, Effect


@functools.cache
def catalogue() -> tuple[Effect, ...]:
    """Every effect of this folder, by stage and id."""
    found: list[Effect] = []
    for module in pkgutil.iter_modules(__path__):
        loaded = importlib.import_module(f"{__name__}.{module.name}")
        found.extend(
            kind()
            for kind in vars(loaded).values()
            if isinstance(kind, type) and issubclass(kind, Effect) and kind.__module__ == loaded.__name__
        )
    return tuple(sorted(found, key=lambda effect: (STAGES.index(effect.stage), effect.id)))

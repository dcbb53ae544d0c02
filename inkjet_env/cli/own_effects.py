"""``--effect``: a user's own effect, by the place of its class or by the name under which a package offers it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from inkjet_env.plant import Effect


def register_own(named: Sequence[str] | None) -> tuple[Effect, ...]:
    """Import and register the classes that ``--effect`` names; return one instance of each.

    Parameters
    ----------
    named : sequence of str or None
        Each is ``module:Class``, or the name of an entry point of the group ``inkjet_env.effects``.

    Raises
    ------
    ValueError
        There is no such class, its module's import fails, or `register` refuses it.
    """
    if not named:
        return ()
    from inkjet_env.naming import nearest_name
    from inkjet_env.plant import catalogue, register
    from inkjet_env.plugins import EFFECTS, installed, plugin

    effects = []
    for name in dict.fromkeys(named):
        try:
            ours = [effect.id for effect in catalogue()]
            if name in ours:
                raise ValueError("it is in the catalogue, whose effects are always looked for. Leave it out.")
            found = plugin(EFFECTS, name, ours)
            if found is None:
                offered = installed(EFFECTS, ours)
                raise ValueError(
                    f"no installed package offers an effect of this name.{nearest_name(name, offered)} Offered: "
                    f"{', '.join(offered) or 'none'}. For a class in a file, give module:Class."
                )
            effects.append(register(found.load())())
        except ValueError as error:
            raise ValueError(f"--effect {name}: {error}") from None
    return tuple(effects)

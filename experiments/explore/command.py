"""``inkjet explore``: the local web application."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from inkjet_env.cli.options import OwnEffects

SESSION = Path("inkjet-explore.json")


def explore(
    printhead: Annotated[
        list[Path] | None,
        typer.Option(help="printhead.json from identify or diagnose, to start with; may be repeated"),
    ] = None,
    campaign: Annotated[
        Path | None, typer.Option(metavar="DIR", help="folder of a campaign to start with", show_default=False)
    ] = None,
    session: Annotated[
        Path, typer.Option(help="file that keeps what is on the page, so that it is there again next time")
    ] = SESSION,
    port: Annotated[int, typer.Option(help="port on this machine; 0: any that is free", min=0, max=65535)] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="whether to open the browser")] = True,
    effect: OwnEffects = None,
) -> None:
    """Explore waveforms, optimisers, recordings and heads in the browser: drag a waveform, and see what the head does.

    inkjet explore

    \b
    inkjet explore --printhead corrected.json --campaign campaign \\
        --no-browser

    The page is served to this machine alone, at an address with a token. Ctrl-C ends it; everything on the page is
    kept in the file of --session.
    """
    from inkjet_env.extras import check_installed

    check_installed("inkjet explore", "bench", "explore")
    from inkjet_env.cli.arguments import check_outputs
    from inkjet_env.cli.own_effects import register_own
    from inkjet_env.experiments.explore.exploration import Exploration

    check_outputs(tuple(printhead or ()), session=session)
    register_own(effect)
    exploration = Exploration.restored(session)
    for file in printhead or ():
        exploration.shelf.chosen = exploration.shelf.add(file).name
    if campaign is not None:
        exploration.recordings.join()
        exploration.recordings.open(campaign)
    from inkjet_env.experiments.explore.server import serve

    server, address = serve(exploration, port)
    exploration.save()
    print(f"inkjet explore: {address}", flush=True)
    if browser:
        import webbrowser

        webbrowser.open(address)
    try:
        server.start()
        server.io_loop.start()
    finally:
        exploration.close()
        server.stop()

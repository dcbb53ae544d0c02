"""Pictures of the four views as a browser shows them, for documentation.

``python -m inkjet_env.experiments.explore.studies.pictures CAMPAIGN FOLDER`` writes one PNG for each view."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from inkjet_env.experiments.explore.studies.browser import (
    START_MS,
    browsing,
    check_quiet,
    find_browser,
    open_page,
    serving,
)
from inkjet_env.extras import MissingExtraError

SETTLED_MS = 1500
"""Time in milliseconds after which nothing moves on the page any more."""


def draw_views(browser: Any, campaign: Path, folder: Path) -> dict[str, Path]:
    """Pictures of *Waveform*, *Optimise* after a search, *Recordings* with a campaign, and *Heads* with best waveforms.

    Parameters
    ----------
    browser : playwright.sync_api.Browser
        The browser.
    campaign : Path
        Folder of a campaign.
    folder : Path
        Where the pictures are written; it must exist.

    Raises
    ------
    RuntimeError
        The page logged an error.
    playwright.sync_api.TimeoutError
        Something that should appear does not.
    """
    found = {name: folder / f"{name}.png" for name in ("waveform", "optimise", "recordings", "heads")}
    with TemporaryDirectory() as scratch, serving(Path(scratch) / "s.json", "--campaign", campaign) as (_, address):
        page = open_page(browser, address)

        def draw(view: str) -> None:
            page.wait_for_timeout(SETTLED_MS)
            page.screenshot(path=found[view])

        draw("waveform")
        page.get_by_text("Optimise", exact=True).click()
        page.get_by_role("button", name="Start").click()
        page.wait_for_selector("#search[data-state=done]", timeout=START_MS)
        draw("optimise")
        page.get_by_text("Recordings", exact=True).click()
        shown = "Bokeh.documents[0].get_model_by_name('recorded left').data.x.length > 0"
        page.wait_for_function(shown, timeout=START_MS)
        draw("recordings")
        page.get_by_text("Heads", exact=True).click()
        page.get_by_role("button", name="Find the best waveforms").click()
        page.get_by_text("cost of its best waveform (V)").wait_for(timeout=START_MS)
        draw("heads")
        check_quiet(page)
        page.close()
    return found


def main(arguments: list[str] | None = None) -> None:
    """Write the pictures."""
    parser = argparse.ArgumentParser(
        prog="python -m inkjet_env.experiments.explore.studies.pictures", description=__doc__
    )
    parser.add_argument("campaign", type=Path, metavar="CAMPAIGN")
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--browser", type=Path, help="path of a Chromium; otherwise the one on PATH")
    chosen = parser.parse_args(arguments)
    chosen.folder.mkdir(parents=True, exist_ok=True)
    try:
        with browsing(find_browser(chosen.browser)) as browser:
            drawn = draw_views(browser, chosen.campaign, chosen.folder)
    except (MissingExtraError, ValueError) as error:
        print(error, file=sys.stderr)
        raise SystemExit(2) from None
    print("\n".join(map(str, drawn.values())))


if __name__ == "__main__":
    main()

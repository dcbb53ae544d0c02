"""How quick the application is in a real browser: milliseconds from slider to picture, memory, long recordings.

``python -m inkjet_env.experiments.explore.studies.speed`` starts ``inkjet explore`` in a process of its own and drives
its page in Chromium: a slider and corners are dragged, and recordings of a million samples are zoomed with the mouse
wheel. It needs Playwright and Chromium, and Linux, whose kernel tells the memory of a process."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from inkjet_env.experiments.explore.studies.browser import browsing, find_browser, serving
from inkjet_env.experiments.explore.studies.long_recordings import recordings_study
from inkjet_env.experiments.explore.studies.sliders import PAGES, memory_study, prepared, python_ms, slider_study, told
from inkjet_env.extras import MissingExtraError
from inkjet_env.reporting.tables import print_table
from inkjet_env.storage import write_json

FORMAT = "explore-speed/1"
PARTS = ("sliders", "memory", "recordings")


def studied(
    browser_file: Path, parts: list[str], pages: list[str], changes: int, samples: int, recordings: int, steps: int
) -> dict[str, Any]:
    """Everything that is asked for, as plain JSON values."""
    found: dict[str, Any] = {"format": FORMAT, "cores": len(os.sched_getaffinity(0))}
    with TemporaryDirectory() as scratch, browsing(browser_file) as browser:
        folder = Path(scratch)
        found["browser"] = f"Chromium {browser.version}"
        if "sliders" in parts:
            found["python_ms"] = {page: told(python_ms(page, changes)) for page in pages}
            found["sliders"] = {}
        for page in pages:
            if page != pages[0] and "sliders" not in parts:
                break
            session = folder / f"{page}.json"
            prepared(session, page).save()
            with serving(session) as (server, address):
                if "sliders" in parts:
                    found["sliders"][page] = slider_study(browser, address, changes)
                if page == pages[0] and "memory" in parts:
                    found["memory"] = memory_study(browser, server, address, changes)
                if page == pages[0] and "recordings" in parts:
                    found["recordings"] = recordings_study(browser, server, address, folder, samples, recordings, steps)
    return found


def print_found(found: dict[str, Any]) -> None:
    """Print the tables."""
    print(f"{found['browser']}, {found['cores']} cores")
    if "sliders" in found:
        rows = []
        for page, slider in found["sliders"].items():
            python = found["python_ms"][page]
            for name, times in (
                ("in Python alone", python), ("to the plot painted", slider["painted_ms"]),
                ("to its next frame", slider["picture_ms"]),
            ):  # fmt: skip
                rows.append((f"{page} page, {name}", f"{times['median']:.1f}", f"{times['p95']:.1f}"))
        print_table(("a change of a slider (ms)", "median", "95 %"), rows)
        rows = [
            (f"{page} page", f"{one['frames_a_change']:.1f}", f"{one['kB_a_change']:.1f}")
            for page, one in found["sliders"].items()
        ]
        print_table(("sent for a change", "frames", "kB"), rows)
    if "memory" in found:
        rows = [
            (f"after {one['drags']:,} drags", f"{one['server_MB']:.1f}", f"{one['heap_MB']:.1f}")
            for one in (found["memory"]["early"], found["memory"]["late"])
        ]
        print_table(("memory", "server (MB)", "page's heap (MB)"), rows)
    if "recordings" in found:
        one = found["recordings"]
        pairs = [
            ("open the folder until shown (s)", f"{one['opened_s']:.1f}"),
            ("server's memory (MB)", f"{one['server_MB']:.0f}"),
            ("a zoom step, median (ms)", f"{one['zoom_ms']['median']:.1f}"),
            ("a zoom step, 95th percentile (ms)", f"{one['zoom_ms']['p95']:.1f}"),
            ("zoomed out: points drawn", f"{one['whole']['measured']['points']:,}"),
            ("zoomed in: points drawn", f"{one['near']['measured']['points']:,}"),
            ("zoomed in: samples there are", f"{one['samples_in_near']:,}"),
            ("a spike of one sample is drawn", "yes" if one["spike_kept"] else "no"),
        ]
        print_table((f"{one['recordings']} recordings of {one['samples']:,} samples", ""), pairs)


def main(arguments: list[str] | None = None) -> None:
    """Measure, print, and write what was found."""
    parser = argparse.ArgumentParser(prog="python -m inkjet_env.experiments.explore.studies.speed", description=__doc__)
    parser.add_argument("--changes", type=int, default=1000, help="changes of a slider, and drags of a corner")
    parser.add_argument("--samples", type=int, default=1_000_000, help="samples of each recording")
    parser.add_argument("--recordings", type=int, default=10, help="number of recordings")
    parser.add_argument("--steps", type=int, default=40, help="zoom steps")
    parser.add_argument("--parts", default=",".join(PARTS), help=f"any of {','.join(PARTS)}")
    parser.add_argument("--pages", default=",".join(PAGES), help="plain, or worst: a train of drops, two pinned")
    parser.add_argument("--browser", type=Path, help="path of a Chromium; otherwise the one on PATH")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write everything that was measured")
    chosen = parser.parse_args(arguments)
    parts, pages = chosen.parts.split(","), chosen.pages.split(",")
    for name, given, known in (("parts", parts, PARTS), ("pages", pages, PAGES)):
        if wrong := [one for one in given if one not in known]:
            parser.error(f"--{name} must be of {', '.join(known)}; got {wrong[0]}.")
    for name, least in (("changes", 1), ("samples", 1000), ("recordings", 1), ("steps", 2)):
        if getattr(chosen, name) < least:
            parser.error(f"--{name} must be at least {least}; got {getattr(chosen, name)}.")
    try:
        found = studied(
            find_browser(chosen.browser), parts, pages, chosen.changes, chosen.samples, chosen.recordings, chosen.steps
        )
    except (MissingExtraError, ValueError) as error:
        print(error, file=sys.stderr)
        raise SystemExit(2) from None
    print_found(found)
    if chosen.json is not None:
        write_json(chosen.json, found)


if __name__ == "__main__":
    main()

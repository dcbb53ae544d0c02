"""``inkjet explore`` in a process of its own, seen by a real Chromium: what the studies share."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from inkjet_env.extras import extra

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
VIEWPORT = {"width": 1280, "height": 1000}
START_MS = 120_000
"""Longest time in milliseconds until the page is there."""
PICTURE_MS = 20_000
"""Longest time in milliseconds that is waited for a picture."""

WATCH = """([figure, source, longest]) => {
    const all = [];
    const visit = (view) => { all.push(view); (view.child_views || []).forEach(visit); };
    Bokeh.index.roots.forEach(visit);
    const view = all.find((one) => one.model.type === "Figure" && one.model.name === figure);
    const data = Bokeh.documents[0].get_model_by_name(source);
    const watch = window.watch = {begin: null, changed: false, told: null, view, data};
    for (const kind of ["pointermove", "keydown", "wheel"])
        document.addEventListener(kind, (event) => {
            if (watch.told !== null && watch.begin === null) watch.begin = event.timeStamp;
        }, {capture: true, passive: true});
    watch.arm = () => {
        watch.begin = null;
        watch.changed = false;
        watch.picture = new Promise((resolve, reject) => {
            watch.told = resolve;
            setTimeout(() => reject(new Error("no picture followed")), longest);
        });
    };
    data.properties.data.change.connect(() => { watch.changed = true; });
    const repaint = view.repaint.bind(view);
    view.repaint = () => {
        repaint();
        if (watch.changed && watch.begin !== null && watch.told !== null) {
            const painted = performance.now() - watch.begin, told = watch.told;
            watch.told = null;
            requestAnimationFrame(() => told([painted, performance.now() - watch.begin]));
        }
    };
}"""
"""Watches a plot: from the next event of the user to the frame after the plot is painted with data that is new."""


def find_browser(named: Path | None = None) -> Path:
    """A Chromium that is installed.

    Raises
    ------
    ValueError
        There is none, or the named file does not exist.
    """
    if named is not None:
        if not named.exists():
            raise ValueError(f"{named}: there is no such browser. Give the path of a Chromium.")
        return named
    for name in BROWSERS:
        if path := shutil.which(name):
            return Path(path)
    raise ValueError(f"none of {', '.join(BROWSERS)} is installed. Install Chromium, or give its path by --browser.")


@contextmanager
def serving(session: Path, *arguments: str | Path) -> Iterator[tuple[int, str]]:
    """The command in a process of its own: its id, and the address of its page.

    Raises
    ------
    RuntimeError
        It does not start; the message is what it said.
    """
    explore = ("inkjet_env.experiments.cli", "explore", "--no-browser", "--session")
    command: list[str | Path] = [sys.executable, "-m", *explore, session]
    with session.with_suffix(".log").open("w+") as log:
        process = subprocess.Popen([*command, *arguments], stdout=subprocess.PIPE, stderr=log, text=True)
        assert process.stdout is not None
        try:
            line = process.stdout.readline()
            if not line.startswith("inkjet explore: http://"):
                log.seek(0)
                raise RuntimeError(f"inkjet explore did not start: {line}{log.read()[-2000:]}")
            yield process.pid, line.split()[2]
        finally:
            process.terminate()
            try:
                process.communicate(timeout=40)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()


@contextmanager
def browsing(browser: Path) -> Iterator[Any]:
    """A browser without a window, as Playwright drives it.

    Raises
    ------
    MissingExtraError
        Playwright is not installed.
    """
    with extra("a study in the browser"):
        from playwright.sync_api import sync_playwright
    with sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=browser, args=["--no-sandbox", "--disable-gpu"])
        try:
            yield opened
        finally:
            opened.close()


def blank_page(browser: Any) -> Any:
    """An empty tab; `check_quiet` tells of errors that it logs."""
    page = browser.new_page(viewport=VIEWPORT, accept_downloads=True)
    page.faults = []
    page.on("pageerror", lambda error: page.faults.append(str(error)))
    page.on("console", lambda said: page.faults.append(said.text) if said.type == "error" else None)
    return page


def load(page: Any, address: str) -> None:
    """Show the application in a tab."""
    page.goto(address)
    page.wait_for_selector("#cost", timeout=START_MS)


def open_page(browser: Any, address: str) -> Any:
    """A tab that shows the application."""
    page = blank_page(browser)
    load(page, address)
    return page


def check_quiet(page: Any) -> None:
    """``RuntimeError`` if the page logged an error."""
    if page.faults:
        raise RuntimeError(f"the page logged an error: {page.faults[0]}")


class Stopwatch:
    """Milliseconds from what a user does to the picture of one plot that shows it.

    Parameters
    ----------
    page : playwright.sync_api.Page
        The tab.
    figure, source : str
        Names of the plot and of its data.
    """

    def __init__(self, page: Any, figure: str, source: str) -> None:
        self.page = page
        page.evaluate(WATCH, [figure, source, PICTURE_MS])

    def time(self, act: Callable[[], object]) -> tuple[float, float]:
        """Do something; milliseconds until the plot is painted, and until the frame after that."""
        self.page.evaluate("watch.arm()")
        act()
        painted_ms, shown_ms = self.page.evaluate("watch.picture")
        return float(painted_ms), float(shown_ms)

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Where the plot draws a point, in pixels of the window."""
        found = self.page.evaluate(
            """([x, y]) => {
                const box = watch.view.canvas_view.el.getBoundingClientRect(), frame = watch.view.frame;
                return [box.x + frame.x_scale.compute(x), box.y + frame.y_scale.compute(y)];
            }""",
            [x, y],
        )
        return float(found[0]), float(found[1])


def resident_bytes(pid: int) -> int:
    """Resident memory of a process, from the kernel's table."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return 1024 * int(line.split()[1])
    raise OSError(f"/proc/{pid}/status: tells no resident memory.")


def heap_bytes(page: Any) -> int:
    """Used JavaScript heap of a page, after its garbage has been collected."""
    protocol = page.context.new_cdp_session(page)
    try:
        protocol.send("HeapProfiler.collectGarbage")
        return int(protocol.send("Runtime.getHeapUsage")["usedSize"])
    finally:
        protocol.detach()

"""Five tasks of a print engineer, each done in a real browser by what a user sees, counted in steps and timed.

``python -m inkjet_env.experiments.explore.studies.tasks`` starts ``inkjet explore`` in a process of its own. Buttons,
fields and sliders are found by their labels, numbers are read off the page, and whether the task is fulfilled is then
checked against the simulator. A step is a click, a field that is filled, a file that is given, or a press of a key; the
seconds are those in which the page works, without anybody thinking."""

from __future__ import annotations

import argparse
import json
import re
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from inkjet_env.experiments.explore.studies.browser import (
    PICTURE_MS,
    browsing,
    check_quiet,
    find_browser,
    open_page,
    serving,
)
from inkjet_env.extras import MissingExtraError
from inkjet_env.jetting import jetting
from inkjet_env.jetting.scans import pulse_width_scan
from inkjet_env.printhead import DriverLimits, PeakCost, Printhead, Waveform, batch
from inkjet_env.recordings.drive import read_drive
from inkjet_env.reporting.tables import print_table
from inkjet_env.rig import record_campaign
from inkjet_env.storage import write_json

FORMAT = "explore-tasks/1"
LIMITS = "lowest_V=-40,highest_V=48,rise_V_per_us=20,fall_V_per_us=20,step_us=0.1"
OTHER_Hz = 60e3
SAVED_S = 1.0
"""Time in seconds after which the session file tells of a change."""
MOST_PRESSES = 300
"""Largest number of keys that halving the residual may take."""


class User:
    """Who does a task on a page: every step is counted.

    Parameters
    ----------
    page : playwright.sync_api.Page
        The tab.
    session : Path
        The session file, by which it is checked afterwards what the page really shows.
    """

    def __init__(self, page: Any, session: Path) -> None:
        self.page, self.session = page, session
        self.clicks = self.keys = self.fields = 0

    def view(self, name: str) -> None:
        """Click on a view's tab."""
        self.clicks += 1
        self.page.locator(".bk-tab").get_by_text(name, exact=True).click()

    def click(self, button: str) -> None:
        """Click on a button."""
        self.clicks += 1
        self.page.get_by_role("button", name=button, exact=True).click()

    def unfold(self, title: str) -> None:
        """Click on the title of a card."""
        self.clicks += 1
        self.page.get_by_text(title, exact=True).click()

    def fill(self, label: str, text: str) -> None:
        """Write into a field, and leave it."""
        self.fields += 1
        field = self.page.get_by_label(label, exact=True)
        field.fill(text)
        field.press("Enter")

    def give(self, place: str, file: Path) -> None:
        """Give a file to the field below or beside a text."""
        self.fields += 1
        self.page.locator(place).locator("visible=true").set_input_files(file)

    def choose(self, label: str, option: str) -> None:
        """Choose from a list."""
        self.clicks += 1
        self.page.get_by_label(label, exact=True).select_option(option)

    def take(self, slider: str) -> None:
        """Click on the handle of a slider."""
        self.clicks += 1
        self._handle(slider).click()

    def _handle(self, slider: str) -> Any:
        return self.page.locator(".noUi-handle").locator("visible=true").nth(SLIDERS.index(slider))

    def press(self, slider: str, key: str) -> None:
        """Press a key on a slider."""
        self.keys += 1
        self._handle(slider).press(key)

    def change(self, act: Callable[[], object]) -> None:
        """Do something, and look until the cost is another one."""
        before = self.page.locator("#cost").get_attribute("data-cost")
        act()
        for _ in range(PICTURE_MS // 10):
            if self.page.locator("#cost").get_attribute("data-cost") != before:
                return
            self.page.wait_for_timeout(10)
        raise RuntimeError("the cost on the page did not change.")

    def see(self, text: str) -> str:
        """Wait until a text is on the page."""
        found = self.page.get_by_text(re.compile(text)).locator("visible=true").first
        found.wait_for(timeout=PICTURE_MS)
        return str(found.inner_text())

    def drive(self) -> Waveform:
        """The waveform that the page keeps in its session file; that is written soon after a change."""
        time.sleep(SAVED_S)
        return Waveform.from_array(self.kept()["waveform"]["drive"]["waveform"])

    def kept(self) -> Any:
        """The session file."""
        return json.loads(self.session.read_text(encoding="utf-8"))


SLIDERS = ("U1", "U2", "t1", "t2", "t3", "t4", "t5")


def find_the_dwell(user: User, folder: Path) -> tuple[bool, str]:
    """Find the dwell that rings most."""
    user.click("Scan the dwell t2")
    user.see("The head rings most at t2")
    user.change(lambda: user.click("Take the highest drop"))
    taken = user.drive()
    found = pulse_width_scan(Printhead.published(), taken, PeakCost(), points=2001)
    best = int(np.nanargmax(found.effective_V))
    reached = float(np.abs(batch.peaks(taken, Printhead.published())[1]).max())
    return reached > 0.99 * found.effective_V[best], f"t2 = {1e6 * taken.t2:.2f} µs: {reached:.2f} V"


def halve_the_residual(user: User, folder: Path) -> tuple[bool, str]:
    """Halve the residual by hand, with the keys of the sliders, looking at the number."""

    def shown() -> float:
        return float(user.page.locator("#residual").inner_text())

    def tried(slider: str, key: str) -> float:
        user.change(lambda: user.press(slider, key))
        return shown()

    before = residual_percent(user.drive())
    first = residual = shown()
    sliders = ("t4", "U2", "t5", "t3", "t2")
    for slider in sliders * 4:
        if residual <= first / 2:
            break
        user.take(slider)
        for key, back in (("PageUp", "PageDown"), ("PageDown", "PageUp")):
            moved = False
            while residual > first / 2 and user.keys < MOST_PRESSES:
                now = tried(slider, key)
                if now >= residual:
                    tried(slider, back)
                    break
                residual, moved = now, True
            if moved:
                break
    after = residual_percent(user.drive())
    return after <= before / 2 + 0.05, f"{before:.1f} % to {after:.1f} %"


def residual_percent(waveform: Waveform) -> float:
    """Residual of a single drop on the published head, in percent of its effective peak."""
    return 100 * jetting(Printhead.published().respond(waveform), PeakCost()).residual


def load_a_scope_folder(user: User, folder: Path) -> tuple[bool, str]:
    """Load a folder of an oscilloscope's files, and see which of them differ from the model."""
    scope = folder / "scope"
    changed = write_scope_folder(scope)
    user.view("Recordings")
    user.fill("folder of a campaign", str(scope))
    user.choose("channel of the files", "self_sensing")
    user.choose("initial state of the files", "periodic")
    user.click("Read")
    user.see("[Tt]he same head")
    user.page.wait_for_timeout(500)
    rows = user.page.locator(".tabulator-row").locator("visible=true")
    name = ".tabulator-cell[tabulator-field=recording]"
    differ = {one.locator(name).inner_text() for one in rows.all() if "differs" in one.inner_text()}
    return differ == changed, f"{', '.join(sorted(differ)) or 'none'} of {rows.count()} differs"


def write_scope_folder(folder: Path) -> set[str]:
    """Files of a scope, one of them of a head with another resonance; the names of those that differ."""
    folder.mkdir()
    head = Printhead.published()
    same, other = (
        [one for one in record_campaign(who, seed=3).select("self_sensing") if one.initial_state == "periodic"]
        for who in (head, head.varied(frequency_Hz=OTHER_Hz))
    )
    for k in range(4):
        one = (other if k == 2 else same)[k]
        rows = [f"{t:.10g},{u:.6g},{s:.8g}" for t, u, s in zip(one.time_s, one.drive_V, one.sensor, strict=True)]
        (folder / f"scope{k + 1}.csv").write_text("\n".join(["time_s,drive_V,sensor_V", *rows]) + "\n")
    return {"scope3"}


def get_a_legal_file(user: User, folder: Path) -> tuple[bool, str]:
    """Get a waveform that the driver can do, as a controller's file of segments."""
    user.unfold("Cost, driver, drive file")
    user.fill("what the driver can do", LIMITS)
    user.see("The drive ")
    user.change(lambda: user.click("Make it legal"))
    user.clicks += 1
    with user.page.expect_download() as download:
        user.page.get_by_text("Segments", exact=True).click()
    file = folder / "waveform.ini"
    download.value.save_as(file)
    read = read_drive(file)
    excesses = DriverLimits.from_text(LIMITS).excesses(read.time_s, read.drive_V)
    legal = not excesses and np.abs(read.drive_V).max() > 10
    return legal, f"{len(read.time_s)} corners, {read.drive_V.min():.1f} to {read.drive_V.max():.1f} V"


def compare_two_heads(user: User, folder: Path) -> tuple[bool, str]:
    """Compare the published head with one of a file: resonance, and the best waveform of each."""
    other = Printhead.published().varied(frequency_Hz=OTHER_Hz)
    other.to_json(folder / "other.json")
    user.view("Heads")
    user.give("input[type=file]", folder / "other.json")
    user.see("^other$")
    user.click("Find the best waveforms")
    user.page.get_by_text("cost of its best waveform (V)").locator("visible=true").wait_for(timeout=4 * PICTURE_MS)
    table = user.page.locator("table.told.text").locator("visible=true")
    user.page.wait_for_function(NO_DASH, timeout=4 * PICTURE_MS)
    cells = {row[0]: row[1:] for row in (one.split("\t") for one in table.inner_text().splitlines()) if len(row) > 2}
    right = True
    time.sleep(SAVED_S)
    best = user.kept()["bests"]["best"]
    for k, (name, head) in enumerate((("published", Printhead.published()), ("other", other))):
        waveform = Waveform.from_array(best[name][0])
        cost_V = head.respond(waveform).cost()
        shown_V = float(cells["cost of its best waveform (V)"][k].replace("−", "-"))
        shown_kHz = float(cells["resonance (kHz)"][k])
        right &= abs(shown_V - cost_V) < 2e-3 and abs(shown_kHz - head.frequency_Hz / 1e3) < 1e-2
    costs = cells["cost of its best waveform (V)"]
    return right, f"{' and '.join(cells['resonance (kHz)'])} kHz, {' and '.join(costs)} V"


NO_DASH = """() => {
    const all = [];
    const visit = (root) => root.querySelectorAll("*").forEach((one) => {
        if (one.tagName === "TR" && one.innerText.startsWith("cost of its best")) all.push(one.innerText);
        if (one.shadowRoot) visit(one.shadowRoot);
    });
    visit(document);
    return all.length > 0 && all.every((one) => !one.includes("–"));
}"""
"""Whether the best waveform of every head is known."""

TASKS: dict[str, Callable[[User, Path], tuple[bool, str]]] = {
    "halve the residual by hand": halve_the_residual,
    "find the dwell that rings most": find_the_dwell,
    "load a scope folder, see what differs": load_a_scope_folder,
    "compare two heads": compare_two_heads,
    "a legal waveform as a controller's file": get_a_legal_file,
}
"""In an order in which none is in the way of another: they share a page, as those of a user do."""


def done(page: Any, session: Path, folder: Path, task: str) -> dict[str, Any]:
    """Do a task, which begins at *Waveform*; its steps, seconds and outcome."""
    folder.mkdir()
    user = User(page, session)
    user.view("Waveform")
    user.clicks = 0
    begin_s = time.perf_counter()
    fulfilled, outcome = TASKS[task](user, folder)
    seconds = time.perf_counter() - begin_s
    check_quiet(page)
    steps = {"clicks": user.clicks, "fields": user.fields, "keys": user.keys}
    return steps | {"seconds": seconds, "fulfilled": bool(fulfilled), "outcome": outcome}


def main(arguments: list[str] | None = None) -> None:
    """Do the tasks, print a table, and exit with 1 if one is not fulfilled."""
    parser = argparse.ArgumentParser(prog="python -m inkjet_env.experiments.explore.studies.tasks", description=__doc__)
    parser.add_argument("--only", type=int, nargs="*", help="numbers of the tasks, from 1", metavar="N")
    parser.add_argument("--browser", type=Path, help="path of a Chromium; otherwise the one on PATH")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write what was found")
    chosen = parser.parse_args(arguments)
    numbers = chosen.only or range(1, len(TASKS) + 1)
    if wrong := [one for one in numbers if not 1 <= one <= len(TASKS)]:
        parser.error(f"--only must be 1 to {len(TASKS)}; got {wrong[0]}.")
    names = [list(TASKS)[one - 1] for one in numbers]
    try:
        with TemporaryDirectory() as scratch, browsing(find_browser(chosen.browser)) as browser:
            session = Path(scratch) / "session.json"
            with serving(session) as (_, address):
                page = open_page(browser, address)
                found = {name: done(page, session, Path(scratch) / f"{k}", name) for k, name in enumerate(names)}
    except (MissingExtraError, ValueError) as error:
        print(error, file=sys.stderr)
        raise SystemExit(2) from None
    print_table(
        ("task", "clicks", "fields", "keys", "seconds", "outcome"),
        [
            (name, str(one["clicks"]), str(one["fields"]), str(one["keys"]), f"{one['seconds']:.1f}",
             one["outcome"] if one["fulfilled"] else f"not fulfilled: {one['outcome']}")
            for name, one in found.items()
        ],
    )  # fmt: skip
    if chosen.json is not None:
        write_json(chosen.json, {"format": FORMAT, "tasks": found})
    if not all(one["fulfilled"] for one in found.values()):
        raise SystemExit(1)


if __name__ == "__main__":
    main()

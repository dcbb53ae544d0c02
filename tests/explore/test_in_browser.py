"""The application in a real browser: Debian's Chromium, driven by Playwright."""

import http.client
import json
import shlex
import shutil
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest

from inkjet_env.plant import catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import Printhead, Waveform
from inkjet_env.recordings.drive import read_drive
from inkjet_env.rig import default_battery, record_campaign
from tests.browser import opened_page
from tests.processes import started, wait_until

HOSTILE = "<img src=x onerror=alert(1)>"
PUBLISHED = Printhead.published()
LABELS = ("trapezoid-60V", "trapezoid-100V", "bipolar-full")
"""Drives of the smallest campaign whose verdict is a named effect."""

ON_SCREEN = """([time_us, volts]) => {
    const all = [];
    const visit = (view) => { all.push(view); (view.child_views || []).forEach(visit); };
    Bokeh.index.roots.forEach(visit);
    const plot = all.find((view) => view.model.type === "Figure");
    const canvas = plot.canvas_view.el.getBoundingClientRect();
    return [canvas.x + plot.frame.x_scale.compute(time_us), canvas.y + plot.frame.y_scale.compute(volts)];
}"""
"""Where the first plot draws a point, in pixels of the window."""

ALLOWED = ("data:", "blob:", "http://127.0.0.1:", "ws://127.0.0.1:")
"""Addresses that the page may ask for."""

pytest.importorskip("panel", reason="panel is not installed")


class Server:
    """The command in a process of its own."""

    def __init__(self, folder):
        self.folder, self.process, self.address = folder, None, ""

    def start(self, *arguments):
        command = ("-m", "inkjet_env.experiments.cli", "explore", "--no-browser", "--session")
        self.process = started(*command, self.folder / "session.json", *arguments)
        line = self.process.stdout.readline()
        assert line.startswith("inkjet explore: http://127.0.0.1:"), line + self.process.stderr.read()
        self.address = line.split()[2]

    def end(self):
        if self.process is not None and self.process.poll() is None:
            self.process.terminate()
            self.process.communicate(timeout=30)


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    made = Server(tmp_path_factory.mktemp("explore"))
    file = made.folder / f"{HOSTILE}.json"
    PUBLISHED.varied(frequency_Hz=60e3).to_json(file)
    made.start("--printhead", file)
    yield made
    made.end()
    shutil.rmtree(made.folder, ignore_errors=True)


class Tabs:
    """Tabs of the browser, and what was wrong in them."""

    def __init__(self, browser, server):
        self.browser, self.server, self.faults = browser, server, []

    def open(self):
        size = {"width": 1280, "height": 900}
        page = opened_page(self.browser, self.faults, ALLOWED, viewport=size, accept_downloads=True)
        page.goto(self.server.address)
        page.wait_for_selector("#cost", timeout=60_000)
        return page


@pytest.fixture(scope="module")
def tabs(server, browser):
    return Tabs(browser, server)


@pytest.fixture(scope="module")
def first(tabs):
    return tabs.open()


@pytest.fixture
def page(tabs, first):
    """The first tab, on *Waveform*; the test fails if anything was wrong in a tab."""
    first.get_by_text("Waveform", exact=True).first.click()
    yield first
    assert tabs.faults == []


def cost_shown(page):
    return float(page.locator("#cost").get_attribute("data-cost"))


def session(server):
    return json.loads((server.folder / "session.json").read_text())


def choose(page, label, option):
    page.get_by_label(label, exact=True).select_option(option)


def test_a_dragged_corner_shows_the_simulators_cost(server, tabs, page):
    other = tabs.open()
    choose(page, "head", "published")
    wait_until(lambda: session(server)["head"] == "published")
    published_V = PUBLISHED.respond(Waveform.from_array(session(server)["waveform"]["drive"]["waveform"])).cost()
    wait_until(lambda: abs(cost_shown(page) - published_V) < 1e-9)  # the axes of the other head are gone
    before = session(server)["waveform"]["drive"]["waveform"]
    corner = 1e6 * (before[2] + before[3]), before[0]
    (x, y), (to_x, to_y) = (page.evaluate(ON_SCREEN, [corner[0] + 3 * k, corner[1] - 25 * k]) for k in (0, 1))
    page.mouse.move(x, y)
    page.mouse.down()
    for step in range(1, 11):
        page.mouse.move(x + (to_x - x) * step / 10, y + (to_y - y) * step / 10)
        page.wait_for_timeout(15)
    page.mouse.up()
    wait_until(lambda: abs(session(server)["waveform"]["drive"]["waveform"][0] - (before[0] - 25)) < 1.5)
    dragged = session(server)["waveform"]["drive"]["waveform"]
    assert dragged[3] == pytest.approx(before[3] + 3e-6, abs=0.2e-6)
    exact_V = PUBLISHED.respond(Waveform.from_array(dragged)).cost()
    for shown in (page, other):  # a second tab shows the same
        assert wait_until(lambda shown=shown: abs(cost_shown(shown) - exact_V) < 1e-9)
    page.get_by_role("button", name="Undo").click()
    assert wait_until(lambda: session(server)["waveform"]["drive"]["waveform"] == before)
    other.close()


def test_what_is_exported_reads_back(server, page, tmp_path):
    corners_V = Waveform.from_array(session(server)["waveform"]["drive"]["waveform"]).knots()[1]
    for label, name in (("CSV", "waveform.csv"), ("Segments", "waveform.ini"), ("JSON", "x.json"), ("PNG", "x.png")):
        with page.expect_download() as download:
            page.get_by_text(label, exact=True).click()
        download.value.save_as(tmp_path / name)
    for name in ("waveform.csv", "waveform.ini"):
        assert read_drive(tmp_path / name).drive_V.max() == pytest.approx(corners_V.max())
    assert json.loads((tmp_path / "x.json").read_text())["cost"] == pytest.approx(cost_shown(page), abs=1e-9)
    assert (tmp_path / "x.png").read_bytes().startswith(b"\x89PNG")


def test_a_search_from_the_page_finds_what_the_command_finds(server, page, inkjet):
    page.get_by_text("Optimise", exact=True).click()
    page.get_by_role("button", name="Start").click()
    page.wait_for_selector("#search[data-state=done]", timeout=60_000)
    found = float(page.locator("#best").get_attribute("data-cost"))
    command = page.get_by_label("the command line that finds the same").input_value().split()
    _, out, _ = inkjet(*command[1:], "--json", "-")
    told = json.loads(out)
    assert (found, told["evaluations"]) == (told["cost"], 2000)
    page.get_by_role("button", name="Edit in Waveform").click()
    page.get_by_text("Waveform", exact=True).first.click()
    assert wait_until(lambda: abs(cost_shown(page) - found) < 1e-9)


def test_dropped_files_can_be_corrected(page, tmp_path):
    time_s = np.arange(1500) * 5e-8
    columns = time_s, 2 * np.cos(2e5 * time_s), 50 * np.sin(2e5 * time_s)
    rows = [f"{t:.9g},{a:.9g},{b:.9g}" for t, a, b in zip(*columns, strict=True)]
    file, hostile = tmp_path / "scope.csv", tmp_path / f"{HOSTILE}.csv"
    for one in (file, hostile):
        one.write_text("\n".join(["time_s,CH1,CH2", *rows]))
    page.get_by_text("Recordings", exact=True).click()
    choosing = page.locator("input[type=file][multiple]")
    choosing.set_input_files(hostile)
    page.get_by_text(f"{HOSTILE}.csv: ").first.wait_for()
    page.get_by_label("channel of the files").select_option("self_sensing")
    choosing.set_input_files(file)
    page.get_by_text("-50 … 50").first.wait_for()  # the drive, guessed by its range
    page.get_by_label("columns of the files").fill("drive=CH1,sensor=CH2")
    page.get_by_label("columns of the files").press("Enter")
    page.get_by_role("button", name="Read").click()
    page.get_by_text("-2 … 2").first.wait_for()
    assert page.locator("img[onerror]").count() == 0


def write_scope_files(folder):
    """Recordings of a slow sensing amplifier in files of two instruments; their columns must be told file by file."""
    slow = next(effect for effect in catalogue() if effect.id == "sensor_bandwidth")
    head = AugmentedPrinthead(PUBLISHED, ((slow, slow.example_values(PUBLISHED)),))
    lines = {line.label: line for line in default_battery(PUBLISHED.frequency_Hz) if line.channel == "self_sensing"}
    chosen = [replace(lines[label], drive_V=lines[label].drive_V[:400], repeats=1) for label in LABELS]
    found = record_campaign(head, 1, battery=chosen, snr_dB=50.0).recordings
    names = ("CH1,CH2", "CH1,CH2", "amp_out,probe_in")  # the last is guessed wrongly: out is what answers, by its name
    for one, name, swapped in zip(found, names, (True, False, False), strict=True):
        columns = (one.time_s, one.sensor, one.drive_V) if swapped else (one.time_s, one.drive_V, one.sensor)
        rows = [",".join(f"{value:.9g}" for value in row) for row in zip(*columns, strict=True)]
        (folder / f"{one.name}.csv").write_text("\n".join([f"time_s,{name}", *rows]))
    return sorted(folder.glob("*.csv"))


def correct(page, recording, what, value):
    """Choose in a cell of the table, and wait until the recordings are read again."""
    cell = page.locator(".tabulator-row", has_text=recording).locator(f"[tabulator-field={what}]")
    cell.click()
    page.locator(".tabulator-edit-list-item", has_text=value).click()
    cell.filter(has_text=value).wait_for()


def test_a_dropped_campaign_is_corrected_and_its_verdict_is_the_commands(server, page, inkjet, tmp_path):
    page.get_by_text("Recordings", exact=True).click()
    choose(page, "channel of the files", "self_sensing")
    choose(page, "initial state of the files", "periodic")
    page.get_by_label("columns of the files").fill("")
    page.get_by_label("columns of the files").press("Enter")
    page.locator("input[type=file][multiple]").set_input_files(write_scope_files(tmp_path))
    page.get_by_text("which of them is the drive cannot be guessed").wait_for()
    correct(page, "r001", "drive", "CH2")
    page.get_by_text("0 … 60").wait_for()
    correct(page, "r003", "drive", "amp_out")
    diagnose = page.get_by_role("button", name="Diagnose")
    running = page.locator("#job", has_text="inkjet diagnose, ")
    refused = page.get_by_text("reading the recordings. Wait for it.")
    diagnose.click()
    running.or_(refused).first.wait_for()
    if refused.is_visible():  # the click came before the button was drawn as disabled
        diagnose.click()
    running.wait_for()
    sentence = page.locator("#diagnose").inner_text(timeout=180_000)
    told = page.get_by_label("the command that gives the same").input_value()
    command = next(shlex.split(line) for line in told.splitlines() if line.startswith("inkjet diagnose"))
    file = Path(command[command.index("--json") + 1])
    ours = json.loads(file.read_text())
    file.unlink()
    status, out, _ = inkjet(*command[1:])
    theirs = json.loads(file.read_text())
    assert (status, sentence) == (0, out.splitlines()[0])
    assert ours["verdict"] == "named"
    assert [effect["id"] for effect in ours["effects"]] == ["sensor_bandwidth"]
    assert {key: ours[key] for key in ("verdict", "effects")} == {key: theirs[key] for key in ("verdict", "effects")}


def test_names_of_files_are_text(server, page):
    choose(page, "head", HOSTILE)
    assert wait_until(lambda: session(server)["head"] == HOSTILE)
    assert page.locator("img[onerror]").count() == 0
    shown = cost_shown(page)
    choose(page, "head", "published")
    assert wait_until(lambda: cost_shown(page) != shown)


REFUSED = ("/", "/?token=wrong", "/ws", "/ws?token=wrong", "/autoload.js?bokeh-autoload-element=1", "/metadata")
SOCKET = {"Upgrade": "websocket", "Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ=="}


@pytest.mark.parametrize("path", REFUSED)
def test_a_request_without_the_token_is_refused(server, path):
    place = urlsplit(server.address)
    connection = http.client.HTTPConnection(place.netloc, timeout=30)
    connection.request("GET", path, headers=SOCKET | {"Connection": "Upgrade"} if path.startswith("/ws") else {})
    assert connection.getresponse().status == 403
    connection.close()


def test_it_fits_a_narrow_screen(page):
    page.set_viewport_size({"width": 390, "height": 844})
    page.wait_for_timeout(300)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390


def test_a_server_that_is_killed_and_started_again_shows_what_was_there(server, tabs, page):
    page.get_by_role("button", name="Pin").click()
    wait_until(lambda: session(server)["waveform"]["pinned"])
    cost = cost_shown(page)
    page.close()
    server.process.kill()
    server.process.communicate()
    server.start()
    again = tabs.open()
    assert cost_shown(again) == cost
    assert again.get_by_text("pin 1").count() >= 1

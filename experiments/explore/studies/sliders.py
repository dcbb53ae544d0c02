"""Milliseconds from a slider to the picture that shows it, the part of it in Python, and memory after many drags."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from inkjet_env.experiments.explore.exploration import Exploration
from inkjet_env.experiments.explore.studies.browser import (
    PICTURE_MS,
    Stopwatch,
    blank_page,
    check_quiet,
    heap_bytes,
    load,
    open_page,
    resident_bytes,
)
from inkjet_env.printhead import Waveform

PAGES = ("plain", "worst")
TRAIN_HZ = 20e3
SHORT = Waveform(95.0, -70.0, 1e-6, 9e-6, 9e-6, 5e-6, 5e-6)
"""A waveform that fits into the period of `TRAIN_HZ`."""
PINNED = (Waveform(80.0, -60.0, 2e-6, 10e-6, 5e-6, 8e-6, 3e-6), Waveform(60.0, -90.0, 3e-6, 7e-6, 4e-6, 6e-6, 9e-6))
WARM = 5
"""Number of changes that are made first and not counted."""


def prepared(session: Path, page: str) -> Exploration:
    """An exploration as ``page`` names it: plain, or the worst: a train at 20 kHz and two pinned waveforms."""
    made = Exploration(session)
    if page == "worst":
        for one in (*PINNED, SHORT):
            made.waveform.change(one)
            if one is not SHORT:
                made.waveform.pin()
        made.waveform.set_drop_frequency(TRAIN_HZ)
    return made


def python_ms(page: str, changes: int) -> list[float]:
    """Milliseconds that each change of a slider takes in Python, the making of the message included."""
    from bokeh.document import Document
    from bokeh.protocol import Protocol
    from panel.io.state import set_curdoc

    from inkjet_env.experiments.explore import style
    from inkjet_env.experiments.explore.page import Page

    style.use()
    protocol, taken_ms = Protocol(), []
    with TemporaryDirectory() as folder:
        document: Any = Document()
        exploration = prepared(Path(folder) / "session.json", page)
        with set_curdoc(document):
            shown = Page(exploration)
            document.add_root(shown.layout.get_root(document))
            slider = shown.views["waveform"].sliders[0]
            document.hold("combine")
            held = document.callbacks._held_events  # what would be sent, as Panel takes it, too
            for k in range(changes + WARM):
                held.clear()
                begin_s = time.perf_counter()
                slider.value = 60.0 + 0.5 * (k % 60)
                shown.redraw()
                message = protocol.create("PATCH-DOC", [one for one in held if hasattr(one, "to_serializable")])
                _ = message.content_json
                taken_ms.append(1e3 * (time.perf_counter() - begin_s))
        exploration.save()
    return taken_ms[WARM:]


class Traffic:
    """What a page gets from the server by its socket: bytes, and frames."""

    def __init__(self, page: Any) -> None:
        self.bytes, self.frames = 0, 0
        page.on("websocket", lambda socket: socket.on("framereceived", self._count))

    def _count(self, payload: Any) -> None:
        self.frames += 1
        self.bytes += len(payload)


def told(times_ms: Sequence[float]) -> dict[str, float]:
    """Median and 95th percentile."""
    return {"median": float(np.median(times_ms)), "p95": float(np.quantile(times_ms, 0.95))}


def slide(page: Any, watch: Stopwatch, changes: int) -> list[tuple[float, float]]:
    """Drag the handle of the first slider to and fro, step by step; wait for each picture."""
    handle = page.locator(".noUi-handle").first
    handle.scroll_into_view_if_needed()
    box = handle.bounding_box()
    track = page.locator(".noUi-base").first.bounding_box()
    y, places = box["y"] + box["height"] / 2, np.arange(0.35, 0.75, 2 / track["width"])
    sweep = np.concatenate([places, places[::-1]])
    page.mouse.move(box["x"] + box["width"] / 2, y)
    page.mouse.down()
    page.mouse.move(track["x"] + 0.3 * track["width"], y)
    page.wait_for_timeout(300)
    times: list[tuple[float, float]] = []
    k = 0
    while len(times) < changes + WARM:
        if k == 0 or k % (sweep.size // 2):  # at the turning points nothing changes
            x = track["x"] + sweep[k % sweep.size] * track["width"]
            times.append(watch.time(partial(page.mouse.move, x, y)))
        k += 1
    page.mouse.up()
    page.wait_for_timeout(300)
    return times[WARM:]


def slider_study(browser: Any, address: str, changes: int) -> dict[str, Any]:
    """Milliseconds from the slider to the picture, and what is sent for it."""
    page = blank_page(browser)
    traffic = Traffic(page)
    load(page, address)
    watch = Stopwatch(page, "response", "sensor")
    bytes_before, frames_before = traffic.bytes, traffic.frames
    times = slide(page, watch, changes)
    check_quiet(page)
    page.close()
    count = len(times) + WARM
    return {
        "changes": len(times),
        "painted_ms": told([one for one, _ in times]),
        "picture_ms": told([one for _, one in times]),
        "frames_a_change": (traffic.frames - frames_before) / count,
        "kB_a_change": (traffic.bytes - bytes_before) / count / 1e3,
    }


def memory_study(browser: Any, server: int, address: str, drags: int) -> dict[str, Any]:
    """Memory of server and page after a tenth of the drags of a corner, and after all.

    Raises
    ------
    RuntimeError
        The page logged an error.
    playwright.sync_api.TimeoutError
        No corner follows the pointer.
    """
    found: dict[str, Any] = {}
    page = open_page(browser, address)
    watch = Stopwatch(page, "drive", "corners")
    begin_us = page.evaluate("watch.data.data.x[2]")
    for number in range(1, drags + 1):
        time_us, volts = page.evaluate("[watch.data.data.x[2], watch.data.data.y[2]]")
        x, y = watch.place(time_us, volts)
        away = 6 if number % 2 else -6
        page.mouse.move(x, y)
        page.mouse.down()
        for step in (1, 2):
            page.mouse.move(x + away * step, y + away * step)
            page.wait_for_timeout(20)
        page.mouse.up()
        page.wait_for_timeout(40)
        if number == 1:
            page.wait_for_function(f"watch.data.data.x[2] !== {begin_us!r}", timeout=PICTURE_MS)
        if number in (max(drags // 10, 1), drags):
            page.wait_for_timeout(500)
            memory = {"server_MB": resident_bytes(server) / 1e6, "heap_MB": heap_bytes(page) / 1e6}
            found |= {"early" if number < drags else "late": {"drags": number} | memory}
    check_quiet(page)
    page.close()
    found.setdefault("early", found["late"])
    return found

"""Long recordings on the page: time until they are shown, milliseconds of a zoom step, peaks that decimation keeps."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.experiments.explore.studies.browser import (
    Stopwatch,
    check_quiet,
    open_page,
    resident_bytes,
)
from inkjet_env.experiments.explore.studies.sliders import told
from inkjet_env.printhead import Printhead, respond_sampled
from inkjet_env.recordings import Campaign, Recording, write_campaign
from inkjet_env.reporting.plotting import time_scale

SAMPLE_RATE_HZ = 5e6
NOISE_V = 2e-3
SPIKE_V = 3.0
"""Height of the single sample that must stay visible."""
READ_MS = 600_000
"""Longest time in milliseconds until the recordings are shown."""
SHOWN = "Bokeh.documents[0].get_model_by_name('recorded left').data.x.length > 0"
SEEN = """name => {
    const data = Bokeh.documents[0].get_model_by_name(name).data, axis = watch.view.model.x_range;
    const pairs = Array.from(data.x, (x, k) => [x, data.y[k]]).filter(([x]) => x >= axis.start && x <= axis.end);
    return {axis: [axis.start, axis.end], points: pairs.length, highest: Math.max(...pairs.map(([, y]) => y))};
}"""


def campaign_of(samples: int, recordings: int) -> Campaign:
    """Recordings of the published head, with noise and a single sample far off; its index: a third of the samples."""
    head, rng = Printhead.published(), np.random.default_rng(0)
    time_s = np.arange(samples) / SAMPLE_RATE_HZ
    found = []
    for k in range(recordings):
        drive_V = 45.0 * np.sin(2 * np.pi * (20e3 + 2e3 * k) * time_s) * (1 + 0.5 * np.sin(2 * np.pi * 50 * time_s))
        sensor_V = respond_sampled(head, time_s, drive_V, initial_state="demagnetised").sensor_V
        sensor_V = sensor_V + rng.normal(0, NOISE_V, samples)
        sensor_V[samples // 3] += SPIKE_V
        found.append(
            Recording(
                f"r{k + 1:03d}", time_s, drive_V, sensor_V, "V", "self_sensing", "arbitrary", "demagnetised", k + 1
            )
        )
    return Campaign("long", tuple(found))


def recordings_study(
    browser: Any, server: int, address: str, folder: Path, samples: int, recordings: int, steps: int
) -> dict[str, Any]:
    """Open a folder of long recordings, zoom in and out with the wheel, and look for the single sample.

    Raises
    ------
    RuntimeError
        The page logged an error.
    """
    campaign = campaign_of(samples, recordings)
    begin_s = time.perf_counter()
    write_campaign(folder / "long", campaign)
    written_s = time.perf_counter() - begin_s
    first = campaign.recordings[0]
    spike_s = float(first.time_s[samples // 3])
    page = open_page(browser, address)
    page.get_by_text("Recordings", exact=True).click()
    page.get_by_label("folder of a campaign").fill(str(folder / "long"))
    page.get_by_label("folder of a campaign").press("Enter")
    begin_s = time.perf_counter()
    page.get_by_role("button", name="Read").click()
    page.wait_for_function(SHOWN, timeout=READ_MS)
    opened_s = time.perf_counter() - begin_s
    page.get_by_label("recording", exact=True).select_option(first.name)
    page.wait_for_timeout(1500)
    memory_MB = resident_bytes(server) / 1e6
    watch = Stopwatch(page, "recorded signal", "recorded measured")
    second = time_scale(first.duration_s)[0]
    whole = seen_now(page)
    page.evaluate("watch.view.el.scrollIntoView({block: 'center'})")
    page.locator(".bk-tool-icon-wheel-zoom").locator("visible=true").nth(1).click()  # that of the second plot
    times, inward = [], -(-steps // 2)
    page.mouse.move(*watch.place(spike_s / second, 0.0))
    for _ in range(inward):
        times.append(watch.time(lambda: page.mouse.wheel(0, -240)))
    page.wait_for_timeout(300)
    near = seen_now(page)
    for _ in range(steps - inward):
        times.append(watch.time(lambda: page.mouse.wheel(0, 240)))
    check_quiet(page)
    page.close()
    begin_s, end_s = (second * one for one in near["measured"]["axis"])
    there = np.count_nonzero((first.time_s >= begin_s) & (first.time_s <= end_s))
    return {
        "samples": samples, "recordings": recordings, "written_s": written_s, "opened_s": opened_s,
        "server_MB": memory_MB, "zoom_ms": told([one for _, one in times]), "steps": len(times),
        "spike_V": SPIKE_V, "whole": whole, "near": near, "samples_in_near": int(there),
        "spike_kept": all(
            one[name]["highest"] > high for one in (whole, near)
            for name, high in (("measured", float(first.sensor[samples // 3]) - 1e-9), ("left", 0.9 * SPIKE_V))
        ),
    }  # fmt: skip


def seen_now(page: Any) -> dict[str, Any]:
    """Of the measured and of the residual plot: ends of the time axis, points within, and the highest of them."""
    return {name: page.evaluate(SEEN, f"recorded {name}") for name in ("measured", "left")}

"""A real browser without a window: the machine's Chromium, driven by Playwright, and what goes wrong in its pages."""

import shutil
from contextlib import contextmanager

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
OWN = ("file:", "data:", "blob:")
"""Addresses that need no network."""


@contextmanager
def launched():
    """A browser that ends with the block; a skip, with its reason, where there is none."""
    reason = "Playwright is not installed (pip install playwright)"
    driver = pytest.importorskip("playwright.sync_api", reason=reason)
    chromium = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if chromium is None:
        pytest.skip("there is no Chromium on this machine (apt-get install chromium)")
    arguments = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
    with driver.sync_playwright() as playing:
        browser = playing.chromium.launch(executable_path=chromium, args=arguments)
        yield browser
        browser.close()


def opened_page(browser, faults, allowed=OWN, **options):
    """A new page whose errors, dialogues and requests for addresses that are not allowed are added to ``faults``."""

    def ask(address):
        if not address.startswith(allowed):
            faults.append(address[:80])

    page = browser.new_page(**options)
    page.on("console", lambda said: faults.append(said.text) if said.type == "error" else None)
    page.on("pageerror", lambda error: faults.append(error.stack or str(error)))
    page.on("dialog", lambda dialog: (faults.append(f"dialog {dialog.message}"), dialog.dismiss()))
    page.on("request", lambda asked: ask(asked.url))
    page.on("websocket", lambda socket: ask(socket.url))
    return page


def load(page, file):
    """Load a page of results, and wait until it says that it is ready."""
    page.goto(file.as_uri())
    page.locator("body[data-ready=yes]").wait_for(timeout=60_000)

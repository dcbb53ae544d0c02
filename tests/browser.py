"""A real browser without a window, asked through its DevTools protocol."""

from __future__ import annotations

import asyncio
import base64
import json
import shutil
import subprocess
from contextlib import contextmanager
from pathlib import Path
from urllib.request import urlopen

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


def found():
    """Path of a Chromium; None where there is none."""
    return next((path for name in BROWSERS if (path := shutil.which(name))), None)


class Tab:
    """One page; what it logs, asks for and throws is kept."""

    def __init__(self, address):
        from tornado.ioloop import IOLoop

        self.loop = IOLoop(make_current=False)
        self.address, self.number, self.events = address, 0, []
        self.socket = self._run(self._connect())

    def _run(self, coroutine):
        async def awaited():
            return await asyncio.wait_for(coroutine, 60)

        return self.loop.run_sync(awaited)

    async def _connect(self):
        from tornado.websocket import websocket_connect

        return await websocket_connect(self.address, max_message_size=2**28)

    async def _ask(self, method, parameters):
        self.number += 1
        number = self.number
        await self.socket.write_message(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(await self.socket.read_message())
            if answer.get("id") == number:
                assert "error" not in answer, answer
                return answer["result"]
            self.events.append(answer)

    def ask(self, method, **parameters):
        """One command; its result."""
        return self._run(self._ask(method, parameters))

    def open(self, file: Path):
        """Load a page, and wait until it says that it is ready."""
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.ask(f"{domain}.enable")
        self.ask("Page.navigate", url=file.as_uri())
        for _ in range(300):
            if self.value("document.body && document.body.dataset.ready") == "yes":
                return
            self._run(asyncio.sleep(0.1))
        raise AssertionError(f"{file} was never ready")

    def value(self, script):
        """What a script comes to."""
        result = self.ask("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def choose(self, node, value):
        """Set a field as a user does."""
        self.value(
            f"(() => {{ const n = document.getElementById({node!r}); n.value = {value!r};"
            " n.dispatchEvent(new Event('change', {bubbles: true})); })()"
        )

    def faults(self):
        """Errors of the page, and what it asked the network for."""
        bad = [e for e in self.events if e["method"] == "Runtime.exceptionThrown"]
        bad += [e for e in self.events if e["method"] == "Log.entryAdded" and e["params"]["entry"]["level"] == "error"]
        bad += [
            e["params"]["request"]["url"][:80]
            for e in self.events
            if e["method"] == "Network.requestWillBeSent"
            and not e["params"]["request"]["url"].startswith(("file:", "data:", "blob:"))
        ]
        return bad

    def picture(self, file: Path):
        """Write the whole page as PNG."""
        size = self.ask("Page.getLayoutMetrics")["cssContentSize"]
        clip = {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}
        shot = self.ask("Page.captureScreenshot", clip=clip, captureBeyondViewport=True)
        file.write_bytes(base64.b64decode(shot["data"]))


@contextmanager
def opened(profile: Path):
    """A browser with one empty tab; it ends with the block."""
    process = subprocess.Popen(
        [found(), "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--window-size=1250,900",
         "--remote-debugging-port=0", f"--user-data-dir={profile}", "about:blank"],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        line = next(line for line in process.stderr if "DevTools listening on" in line)
        port = line.split("ws://127.0.0.1:")[1].split("/")[0]
        with urlopen(f"http://127.0.0.1:{port}/json") as answer:
            page = next(target for target in json.load(answer) if target["type"] == "page")
        yield Tab(page["webSocketDebuggerUrl"])
    finally:
        process.kill()
        process.communicate()

"""A headless Chromium, driven over its DevTools protocol: enough to open a page, press keys and
look."""

from __future__ import annotations

import asyncio
import itertools
import json
import shutil
import subprocess
import time
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
SWITCHES = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--remote-debugging-port=0",
)
PATIENCE_S = 300  # a hang
KEYS = {"ArrowLeft": 37, "Home": 36}


class Browser:
    """One Chromium with one page. `events` holds every event since the last `open`."""

    def __init__(self, folder: Path) -> None:
        self.process = subprocess.Popen(
            [CHROMIUM, *SWITCHES, f"--user-data-dir={folder}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self.loop, self.ids, self.events = asyncio.new_event_loop(), itertools.count(1), []
        try:
            self.socket = self.wait(self._connect(folder / "DevToolsActivePort"))
            target = self.call("Target.createTarget", url="about:blank")["targetId"]
            self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)[
                "sessionId"
            ]
            for domain in ("Page", "Runtime", "Network", "Log"):
                self.call(f"{domain}.enable")
        except BaseException:
            self.process.kill()
            raise

    session: str | None = None

    def wait(self, work: Coroutine) -> Any:
        """The outcome of `work`, which may not take for ever."""
        return self.loop.run_until_complete(asyncio.wait_for(work, PATIENCE_S))

    async def _connect(self, port_file: Path) -> Any:
        from tornado.websocket import websocket_connect

        while not (port_file.exists() and port_file.read_text().count("\n")):
            await asyncio.sleep(0.05)
        port, path = port_file.read_text().split("\n")[:2]
        return await websocket_connect(f"ws://127.0.0.1:{port}{path}", max_message_size=2**28)

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """A command's result; events that come before it are kept."""
        return self.wait(self._call(method, params))

    async def _call(self, method: str, params: dict[str, Any]) -> dict[str, Any]:
        number = next(self.ids)
        session = {"sessionId": self.session} if self.session else {}
        await self.socket.write_message(
            json.dumps({"id": number, "method": method, "params": params, **session})
        )
        while True:
            message = json.loads(await self.socket.read_message())
            if message.get("id") == number:
                assert "error" not in message, (method, message["error"])
                return message["result"]
            self.events.append(message)

    def open(self, page: Path) -> None:
        """Load a file into a window of 1280 × 900 CSS pixels; wait until it has drawn itself."""
        size = {"width": 1280, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        light = [{"name": "prefers-color-scheme", "value": "light"}]
        self.call("Emulation.setEmulatedMedia", features=light)
        self.events.clear()
        self.call("Page.navigate", url=page.resolve().as_uri())
        end = time.monotonic() + PATIENCE_S
        while not any(event["method"] == "Page.loadEventFired" for event in self.events):
            assert time.monotonic() < end, f"{page} does not load"
            self.run("1")
        self.settle()

    def settle(self) -> None:
        """Wait for two frames."""
        self.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def run(self, script: str) -> Any:
        """The value of a JavaScript expression, awaited."""
        answer = self.call(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def press(self, key: str) -> None:
        """Press and release one key."""
        text = {"text": key} if len(key) == 1 else {}
        code = KEYS.get(key, ord(key[0]))
        for kind in ("keyDown", "keyUp"):
            self.call(
                "Input.dispatchKeyEvent",
                type=kind,
                key=key,
                windowsVirtualKeyCode=code,
                **(text if kind == "keyDown" else {}),
            )
        self.settle()

    def close(self) -> None:
        """End the browser that was started here."""
        self.session = None
        try:
            self.call("Browser.close")
            self.process.wait(PATIENCE_S)
        except Exception:
            self.process.kill()
        finally:
            self.loop.close()

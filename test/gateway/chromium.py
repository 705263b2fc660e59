# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A headless Chromium of Debian that a test drives by its DevTools protocol."""

from __future__ import annotations

import base64
import itertools
import json
import re
import shutil
import subprocess
import time
import urllib.request
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from pathlib import Path

PROGRAM = shutil.which("chromium")


class Browser:
    """One page of a browser of its own.

    Parameters
    ----------
    folder : Path
        For its profile.
    """

    def __init__(self, folder: Path) -> None:
        if PROGRAM is None:
            pytest.skip("chromium is not on this machine: sudo apt install chromium")
        sockets = pytest.importorskip("websockets.sync.client")
        flags = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
        flags += ["--remote-debugging-port=0", f"--user-data-dir={folder}", "--hide-scrollbars"]
        flags += ["--no-first-run", "--disable-extensions", "--ignore-certificate-errors"]
        flags += ["--disable-background-networking", "--disable-component-update"]
        flags += ["--disable-quic", "--disable-sync"]
        self._process = subprocess.Popen(
            [PROGRAM, *flags, "about:blank"], stderr=subprocess.PIPE, text=True
        )
        assert self._process.stderr is not None
        port = ""
        for line in self._process.stderr:
            found = re.search(r"DevTools listening on ws://127\.0\.0\.1:(\d+)/", line)
            if found:
                port = found.group(1)
                break
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=60) as answer:
            pages = [p for p in json.load(answer) if p["type"] == "page"]
        address = pages[0]["webSocketDebuggerUrl"]
        self._socket = sockets.connect(address, max_size=None, open_timeout=60)
        self._numbers = itertools.count(1)
        self.told: list[dict[str, Any]] = []
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: object) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv(timeout=120))
            if message.get("id") == number:
                assert "error" not in message, message
                result: dict[str, Any] = message["result"]
                return result
            self.told.append(message)

    def open(self, address: str) -> None:
        """Go to an address and wait until it is there."""
        self.call("Page.navigate", url=address)
        self.wait_for("document.readyState === 'complete' && location.href !== 'about:blank'")

    def run(self, script: str) -> Any:
        """Return the value of an expression in the page."""
        found = self.call(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def text(self, selector: str) -> str:
        """Return the text of an element."""
        return str(self.run(f"document.querySelector({json.dumps(selector)}).innerText"))

    def wait_for(self, script: str, most_s: float = 120.0) -> None:
        """Wait until an expression in the page is true."""
        end = time.monotonic() + most_s
        while True:
            found = self.call(
                "Runtime.evaluate", expression=f"Boolean({script})", returnByValue=True
            )
            if found["result"].get("value"):
                return
            assert time.monotonic() < end, (script, found)
            time.sleep(0.05)

    def resize(self, width: int, height: int, *, dark: bool = False, scale: float = 1.0) -> None:
        """Take another size and the dark or light colours."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=scale,
            mobile=width < 600,
        )
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.call("Emulation.setEmulatedMedia", media="screen", features=scheme)

    def paper(self, width: int) -> None:
        """Take the style of a printed page of a width [px]; `resize` takes the screen's again."""
        self.resize(width, 1000)
        self.call("Emulation.setEmulatedMedia", media="print", features=[])

    def printed(self) -> bytes:
        """Return the page as PDF, backgrounds included."""
        found = self.call("Page.printToPDF", printBackground=True, preferCSSPageSize=True)
        return base64.b64decode(found["data"])

    def press(self, key: str, code: int) -> None:
        """Press a key and let it go."""
        text = {"text": "\r"} if key == "Enter" else {}
        given = {"key": key, "code": key, "windowsVirtualKeyCode": code, **text}
        self.call("Input.dispatchKeyEvent", type="keyDown", **given)
        self.call("Input.dispatchKeyEvent", type="keyUp", **given)

    def shoot(self, path: Path, *, whole: bool = True) -> None:
        """Write a picture of the page."""
        found = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(found["data"]))

    def complaints(self) -> list[str]:
        """Return what the page or the browser complained about: errors and what was blocked."""
        found = []
        for message in self.told:
            if message["method"] == "Runtime.exceptionThrown":
                found.append(json.dumps(message["params"]["exceptionDetails"])[:300])
            if message["method"] == "Log.entryAdded" and message["params"]["entry"]["level"] == (
                "error"
            ):
                found.append(message["params"]["entry"]["text"])
        return found

    def asked(self) -> list[str]:
        """Return the addresses that were asked for."""
        sent = [m for m in self.told if m["method"] == "Network.requestWillBeSent"]
        return [m["params"]["request"]["url"] for m in sent]

    def close(self) -> None:
        """End it."""
        self._socket.close()
        self._process.terminate()
        try:
            self._process.wait(30)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        assert self._process.stderr is not None
        self._process.stderr.close()

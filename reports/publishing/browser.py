"""Debian's Chromium without a window, driven over a pipe: to photograph pages, and to test them."""

import base64
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from recon.errors import RescoreError

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
"""Path of the browser; None where none is installed."""
_OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--remote-debugging-pipe"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync", "--mute-audio"),
    # whatever asks for an address gets none, so that a page cannot load anything
    *("--hide-scrollbars", "--host-resolver-rules=MAP * ~NOTFOUND"),
)
_TIMEOUT_S = 60.0


@dataclass(eq=False)
class BrowserPage:
    """One page of a browser. What it complains of and asks for is kept."""

    _to_browser: int
    _from_browser: int
    session: str = ""
    complaints: list[str] = field(default_factory=list)
    """Errors and warnings of the console, and exceptions."""
    requests: list[str] = field(default_factory=list)
    """Addresses that the page asked for, without data addresses in the page itself."""
    _seen: list[dict[str, Any]] = field(default_factory=list)
    _rest: bytes = b""
    _last_id: int = 0

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The answer to a command of the DevTools protocol.

        Raises:
            RescoreError: the browser refuses the command or does not answer.
        """
        self._last_id += 1
        message: dict[str, Any] = {"id": self._last_id, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self._to_browser, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._last_id:
                break
        if "error" in answer:
            raise RescoreError(f"chromium: expected {method} to work, got {answer['error']}; check its use")
        result: dict[str, Any] = answer["result"]
        return result

    def wait_for(self, event: str) -> dict[str, Any]:
        """The first event of this name since the last ``open``."""
        while True:
            for message in self._seen:
                if message["method"] == event:
                    parameters: dict[str, Any] = message["params"]
                    return parameters
            self._next()

    def open(self, file: Path, width_px: int = 1200, height_px: int = 800, dark: bool = False) -> float:
        """Load a file at a width and theme; seconds until its load event."""
        phone = width_px < 600
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width_px,
            height=height_px,
            deviceScaleFactor=2 if phone else 1,
            mobile=phone,
        )
        theme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[theme])
        self._seen.clear()
        began = time.perf_counter()
        answer = self.call("Page.navigate", url=file.resolve().as_uri())
        if "errorText" in answer:
            raise RescoreError(f"{file}: expected a page, got {answer['errorText']}; check the path")
        self.wait_for("Page.loadEventFired")
        return time.perf_counter() - began

    def run(self, script: str) -> Any:
        """The value of a JavaScript expression; a promise is awaited.

        Raises:
            RescoreError: it throws.
        """
        answer = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            text = answer["exceptionDetails"].get("exception", {}).get("description", "an exception")
            raise RescoreError(f"chromium: expected a value of {script[:60]!r}, got {text}; mend the script")
        return answer["result"].get("value")

    def wait_until(self, script: str) -> None:
        """Wait until a JavaScript expression is true.

        Raises:
            RescoreError: it never is.
        """
        end = time.perf_counter() + _TIMEOUT_S
        while not self.run(script):
            if time.perf_counter() > end:
                raise RescoreError(
                    f"chromium: expected {script!r} within {_TIMEOUT_S:g} s, got false; look at the page"
                )
            time.sleep(0.02)

    def press(self, key: str, code: int, text: str = "") -> None:
        """Press and release a key, such as ("Tab", 9) or ("Enter", 13, "\\r")."""
        pressed = {"key": key, "code": key, "windowsVirtualKeyCode": code, "text": text}
        self.call("Input.dispatchKeyEvent", type="keyDown", **pressed)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key, code=key, windowsVirtualKeyCode=code)

    def picture(self, whole_page: bool = False) -> bytes:
        """PNG of what the page shows, in the window or from top to bottom of the page."""
        clip = {}
        if whole_page:
            size = self.call("Page.getLayoutMetrics")["cssContentSize"]
            clip = {"clip": {**size, "scale": 1}, "captureBeyondViewport": True}
        shot = self.call("Page.captureScreenshot", format="png", **clip)
        return base64.b64decode(shot["data"])

    def pdf(self) -> bytes:
        """The page as it would be printed on A4."""
        size = {"paperWidth": 8.27, "paperHeight": 11.69, "printBackground": True}
        return base64.b64decode(self.call("Page.printToPDF", **size)["data"])

    def _next(self) -> dict[str, Any]:
        """The next message of the browser; events are kept."""
        while b"\0" not in self._rest:
            if not select.select([self._from_browser], [], [], _TIMEOUT_S)[0]:
                raise RescoreError(
                    f"chromium: expected an answer within {_TIMEOUT_S:g} s, got none; try again"
                )
            data = os.read(self._from_browser, 1 << 20)
            if not data:
                raise RescoreError(
                    "chromium: expected an answer, got none, it has ended; start it by hand to see why"
                )
            self._rest += data
        first, _, self._rest = self._rest.partition(b"\0")
        message: dict[str, Any] = json.loads(first)
        if "method" in message:
            self._seen.append(message)
            self._note(message["method"], message.get("params", {}))
        return message

    def _note(self, event: str, parameters: dict[str, Any]) -> None:
        if event == "Runtime.exceptionThrown":
            details = parameters["exceptionDetails"]
            self.complaints.append(details.get("exception", {}).get("description", details["text"]))
        elif event == "Runtime.consoleAPICalled" and parameters["type"] in ("error", "warning", "assert"):
            self.complaints.append(" ".join(str(a.get("value", a)) for a in parameters["args"]))
        elif event == "Log.entryAdded" and parameters["entry"]["level"] in ("error", "warning"):
            self.complaints.append(parameters["entry"]["text"])
        elif event == "Network.requestWillBeSent":
            url = parameters["request"]["url"]
            if not url.startswith("data:"):
                self.requests.append(url)


@contextmanager
def open_browser() -> Iterator[BrowserPage]:
    """A page of a new browser, which is ended with the block.

    Raises:
        RescoreError: no Chromium is installed, or it does not start.
    """
    if CHROMIUM is None:
        raise RescoreError("chromium: expected a browser, found none; apt-get install chromium")
    to_read, to_write = os.pipe()
    from_read, from_write = os.pipe()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        # the browser reads file descriptor 3 and writes 4
        command = f'exec "$0" "$@" 3<&{to_read} 4>&{from_write}'
        process = subprocess.Popen(
            ["bash", "-c", command, CHROMIUM, *_OPTIONS, f"--user-data-dir={profile}"],
            pass_fds=(to_read, from_write),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_read)
        os.close(from_write)
        try:
            yield _first_page(to_write, from_read)
        finally:
            os.close(to_write)
            os.close(from_read)
            process.terminate()
            process.wait(_TIMEOUT_S)


def _first_page(to_browser: int, from_browser: int) -> BrowserPage:
    page = BrowserPage(to_browser, from_browser)
    target = page.call("Target.createTarget", url="about:blank")["targetId"]
    page.session = page.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
    for domain in ("Page", "Runtime", "Log", "Network"):
        page.call(f"{domain}.enable")
    return page

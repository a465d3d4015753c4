"""One headless Chromium that a test drives: over its debugging pipe, so that one browser serves several looks at a page
that lives (`tests/browser.py` takes one look at a page that does not)."""

from __future__ import annotations

import base64
import fcntl
import json
import os
import select
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import pytest

from tests.browser import CHROMIUM

_PATIENCE_S: Final = 120.0
"""Of a machine that is busy with other things."""
_POLL_S: Final = 0.2


class Session:
    """A browser with one page. A context; skips the test where there is no Chromium."""

    def __init__(self, folder: Path) -> None:
        if CHROMIUM is None:
            pytest.skip("no /usr/bin/chromium here (apt-get install chromium)")
        self._folder = folder
        self._number = 0
        self._buffer = b""
        self.console: list[str] = []
        """Warnings, errors and uncaught exceptions of the page."""
        self.asked: list[str] = []
        """Every address that was asked for."""

    def __enter__(self) -> Session:
        reader, self._write = os.pipe()
        self._read, writer = os.pipe()
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD, 20) for end in (reader, writer)]
        for end in (reader, writer):
            os.close(end)
        command = [
            str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
            "--disable-component-update", "--disable-sync", "--no-first-run", "--disable-default-apps",
            "--remote-debugging-pipe", f"--user-data-dir={self._folder / 'profile'}", "about:blank",
        ]  # fmt: skip
        shell = f'exec "$@" 3<&{ends[0]} 4>&{ends[1]}'
        self._process = subprocess.Popen(
            ["bash", "-c", shell, "bash", *command],
            pass_fds=ends, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            env=os.environ | {"HOME": str(self._folder)},
        )  # fmt: skip
        for end in ends:
            os.close(end)
        pages = self._call("Target.getTargets")["targetInfos"]
        target = next(one["targetId"] for one in pages if one["type"] == "page")
        self._session: str | None = self._call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._call(f"{domain}.enable")
        return self

    def __exit__(self, *error: object) -> None:
        self._process.terminate()
        self._process.wait(_PATIENCE_S)
        os.close(self._write)
        os.close(self._read)

    def size(self, width: int, height: int, is_phone: bool = False) -> None:
        self._call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=is_phone
        )

    def open(self, url: str) -> None:
        self._call("Page.navigate", url=url)

    def value(self, expression: str) -> Any:
        """Of a JavaScript expression on the page."""
        result = self._call("Runtime.evaluate", expression=expression, returnByValue=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def until(self, expression: str, is_so: Callable[[Any], bool] = bool) -> Any:
        """Polls until the value of an expression is so."""
        deadline_s = time.monotonic() + _PATIENCE_S
        while not is_so(value := self.value(expression)):
            assert time.monotonic() < deadline_s, f"{expression} is {value!r}"
            time.sleep(_POLL_S)
        return value

    def screenshot(self, picture: Path, is_whole: bool = False) -> None:
        """What the window shows, or the whole page, kept as a PNG."""
        picture.parent.mkdir(parents=True, exist_ok=True)
        shot = self._call("Page.captureScreenshot", captureBeyondViewport=is_whole)
        picture.write_bytes(base64.b64decode(shot["data"]))

    def outside(self) -> list[str]:
        """Addresses that were asked for and are not of this machine."""
        own = ("http://127.0.0.1", "data:", "file:", "blob:", "about:", "chrome")
        return [url for url in self.asked if not url.startswith(own)]

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        request: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if getattr(self, "_session", None) and not method.startswith("Target."):
            request["sessionId"] = self._session
        os.write(self._write, json.dumps(request).encode() + b"\0")
        deadline_s = time.monotonic() + _PATIENCE_S
        while True:
            message = self._next(deadline_s)
            if message.get("id") == self._number:
                assert "error" not in message, message
                return message["result"]  # type: ignore[no-any-return]
            self._note(message)

    def _next(self, deadline_s: float) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._read], [], [], max(0.0, deadline_s - time.monotonic()))
            assert ready, "the browser does not answer"
            data = os.read(self._read, 1 << 20)
            assert data, "the browser has gone"
            self._buffer += data
        line, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(line)  # type: ignore[no-any-return]

    def _note(self, message: dict[str, Any]) -> None:
        told = message.get("params", {})
        match message.get("method"):
            case "Runtime.consoleAPICalled" if told["type"] in ("error", "warning", "assert"):
                self.console.append(json.dumps(told["args"]))
            case "Runtime.exceptionThrown":
                self.console.append(json.dumps(told["exceptionDetails"]))
            case "Log.entryAdded" if told["entry"]["level"] == "error":
                self.console.append(f"{told['entry']['text']} {told['entry'].get('url', '')}")
            case "Network.requestWillBeSent":
                self.asked.append(told["request"]["url"])
            case _:
                pass

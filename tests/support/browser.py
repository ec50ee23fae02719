"""A headless Chromium for tests, driven over the WebDriver protocol (W3C): a few requests need no library."""

from __future__ import annotations

import contextlib
import json
import shutil
import socket
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
MISSING = "no browser: install chromium and chromium-driver"

FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-quic",
    "--no-first-run",
    "--no-default-browser-check",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
    "--host-resolver-rules=MAP * ~NOTFOUND",  # not even an address is looked up
)
ENTER = "\ue007"
TAB = "\ue004"
ELEMENT = "element-6066-11e4-a52e-4f735466cecf"  # the key of an element in the protocol


class Browser:
    """One window; what the console and the network did in it is kept."""

    def __init__(self, session: str) -> None:
        self._session = session

    def open(self, page: Path) -> None:
        """Load a file as a user does who opens it."""
        self._post("url", {"url": page.absolute().as_uri()})

    def script(self, body: str, *arguments: object) -> Any:
        """What a function of this body returns in the page."""
        return self._post("execute/sync", {"script": body, "args": list(arguments)})

    def wait_for(self, body: str, seconds: float = 30.0) -> Any:
        """What a function of this body returns as soon as that is something; at the end, whatever it is."""
        end = time.monotonic() + seconds
        while not (found := self.script(body)) and time.monotonic() < end:
            time.sleep(0.1)
        return found

    def click(self, selector: str) -> None:
        """Click where the element is; fails where something covers it."""
        self._post(f"element/{self._find(selector)}/click", {})

    def type(self, selector: str, text: str) -> None:
        """Send keys to an element."""
        self._post(f"element/{self._find(selector)}/value", {"text": text})

    def resize(self, width: int, height: int) -> None:
        """Show the page in so many CSS pixels, narrower too than a window of a desktop may be."""
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 640}
        self.devtools("Emulation.setDeviceMetricsOverride", **metrics)

    def prefer(self, scheme: str) -> None:
        """Prefer the scheme ``light`` or ``dark``."""
        self.devtools("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])

    def first_of_all(self, body: str) -> None:
        """Run this script in every page before its own."""
        self.devtools("Page.addScriptToEvaluateOnNewDocument", source=body)

    def devtools(self, command: str, **parameters: object) -> Any:
        """Send a command of the DevTools protocol."""
        return self._post("goog/cdp/execute", {"cmd": command, "params": parameters})

    def console(self) -> list[str]:
        """Messages of the console since the last call, of every level."""
        return [entry["message"] for entry in self._log("browser")]

    def requests(self) -> list[str]:
        """Addresses that the page asked for since the last call, itself included.

        Not those of the browser's own first page, which may still be loading, and for which no page can ask.
        """
        events = [json.loads(entry["message"])["message"] for entry in self._log("performance")]
        asked = (e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent")
        return [address for address in asked if not address.startswith("chrome://")]

    def forget(self) -> None:
        """Leave out of the next ``console`` and ``requests`` what happened so far."""
        self.console()
        self.requests()

    def _log(self, kind: str) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = self._post("se/log", {"type": kind})
        return found

    def _find(self, selector: str) -> str:
        found: dict[str, str] = self._post("element", {"using": "css selector", "value": selector})
        return found[ELEMENT]

    def _post(self, command: str, content: dict[str, Any]) -> Any:
        return _call(f"{self._session}/{command}", content)


@contextlib.contextmanager
def chromium(folder: Path) -> Iterator[Browser]:
    """A browser whose profile is in the empty ``folder``; it ends with the context."""
    assert DRIVER is not None
    port = _free_port()
    log = folder / "driver.log"
    with subprocess.Popen(
        [DRIVER, f"--port={port}", f"--log-path={log}"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as driver:
        try:
            server = f"http://127.0.0.1:{port}"
            _wait(server)
            session = f"{server}/session/{_call(f'{server}/session', _wishes(folder / 'profile'))['sessionId']}"
            try:
                yield Browser(session)
            finally:
                _call(session, method="DELETE")
        finally:
            driver.terminate()


def _wishes(profile: Path) -> dict[str, Any]:
    options = {"binary": CHROMIUM, "args": [*FLAGS, f"--user-data-dir={profile}"]}
    logs = {"browser": "ALL", "performance": "ALL"}
    wanted = {"browserName": "chrome", "goog:chromeOptions": options, "goog:loggingPrefs": logs}
    return {"capabilities": {"alwaysMatch": wanted}}


def _call(address: str, content: dict[str, Any] | None = None, method: str | None = None) -> Any:
    body = None if content is None else json.dumps(content).encode()
    request = urllib.request.Request(address, body, {"Content-Type": "application/json"}, method=method)
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))  # the driver is on this machine
    try:
        with opener.open(request, timeout=60) as answer:
            return json.load(answer)["value"]
    except urllib.error.HTTPError as error:
        with error:
            raise AssertionError(f"{address}: {json.load(error)['value']['message']}") from None


def _wait(server: str) -> None:
    for _ in range(200):
        with contextlib.suppress(urllib.error.URLError, ConnectionError):
            if _call(f"{server}/status")["ready"]:
                return
        time.sleep(0.1)
    raise AssertionError("chromedriver does not answer")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port

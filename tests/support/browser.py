"""A headless Chromium for tests, driven over the WebDriver protocol (W3C): a few requests need no library."""

import contextlib
import json
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mtp_bench.viz.rerun.viewer import free_port
from tests.support.headless_viewer import until
from tests.support.programs import CHROMEDRIVER, CHROMIUM

SWITCHES = (
    "headless=new", "no-sandbox", "disable-gpu", "disable-dev-shm-usage", "disable-quic", "no-first-run",
    "no-default-browser-check", "disable-background-networking", "disable-component-update", "disable-sync",
    "disable-extensions", "host-resolver-rules=MAP * ~NOTFOUND",  # addresses are not even looked up
)  # fmt: skip
FLAGS = [f"--{switch}" for switch in SWITCHES]
ENTER = "\ue007"
ELEMENT = "element-6066-11e4-a52e-4f735466cecf"  # the key of an element in the protocol


class Browser:
    """A window with a log of its console and its network."""

    def __init__(self, session: str) -> None:
        self._session = session

    def open(self, page: Path) -> None:
        self._post("url", {"url": page.absolute().as_uri()})

    def script(self, body: str, *arguments: object) -> Any:
        """The result of a function of this body in the page."""
        return self._post("execute/sync", {"script": body, "args": list(arguments)})

    def wait_for(self, body: str, seconds: float = 30.0) -> Any:
        """The first true result of a function of this body, or its result after so many seconds."""
        end = time.monotonic() + seconds
        while not (found := self.script(body)) and time.monotonic() < end:
            time.sleep(0.1)
        return found

    def click(self, selector: str) -> None:
        self._post(f"element/{self._find(selector)}/click", {})

    def type(self, selector: str, text: str) -> None:
        self._post(f"element/{self._find(selector)}/value", {"text": text})

    def resize(self, width: int, height: int) -> None:
        """Show the page in so many CSS pixels, which may be narrower than a window of a desktop."""
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 640}
        self.devtools("Emulation.setDeviceMetricsOverride", **metrics)

    def prefer(self, scheme: str) -> None:
        self.devtools("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])

    def devtools(self, command: str, **parameters: object) -> None:
        self._post("goog/cdp/execute", {"cmd": command, "params": parameters})

    def console(self) -> list[str]:
        """Messages of the console since the last call, of every level."""
        return [entry["message"] for entry in self._log("browser")]

    def requests(self) -> list[str]:
        """Addresses requested by the page since the last call, its own included.

        Without those of the browser's first page, which may still be loading.
        """
        events = [json.loads(entry["message"])["message"] for entry in self._log("performance")]
        asked = (e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent")
        return [address for address in asked if not address.startswith("chrome://")]

    def forget(self) -> None:
        self.console()
        self.requests()

    def _log(self, kind: str) -> Any:
        return self._post("se/log", {"type": kind})

    def _find(self, selector: str) -> Any:
        return self._post("element", {"using": "css selector", "value": selector})[ELEMENT]

    def _post(self, command: str, content: dict[str, Any]) -> Any:
        return _call(f"{self._session}/{command}", content)


@contextlib.contextmanager
def chromium(folder: Path) -> Iterator[Browser]:
    """A browser whose profile is in the empty ``folder``; it ends with the context."""
    port, quiet = free_port(), subprocess.DEVNULL
    command = [str(CHROMEDRIVER), f"--port={port}", f"--log-path={folder / 'driver.log'}"]
    server = f"http://127.0.0.1:{port}"
    options = {"binary": CHROMIUM, "args": [*FLAGS, f"--user-data-dir={folder / 'profile'}"]}
    logs = {"browser": "ALL", "performance": "ALL"}
    wishes = {"browserName": "chrome", "goog:chromeOptions": options, "goog:loggingPrefs": logs}
    with subprocess.Popen(command, stdout=quiet, stderr=quiet) as driver:
        try:
            until(lambda: _call(f"{server}/status"))
            made = _call(f"{server}/session", {"capabilities": {"alwaysMatch": wishes}})
            session = f"{server}/session/{made['sessionId']}"
            try:
                yield Browser(session)
            finally:
                _call(session, method="DELETE")
        finally:
            driver.terminate()


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

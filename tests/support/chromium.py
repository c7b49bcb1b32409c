"""A headless Chromium controlled by a test with the DevTools protocol, through two pipes: no port, no library."""

import base64
import contextlib
import json
import os
import select
import shutil
import subprocess
import time
from pathlib import Path

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu-sandbox", "--disable-dev-shm-usage", "--no-first-run"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars"),
    *("--disable-background-networking", "--disable-component-update", "--remote-debugging-pipe"),
)
_DRIVER_MESSAGE = "GL Driver Message"
"""In the log of a browser without a graphics card: that pictures of a scene are slow."""
# Chromium's own choice without a graphics card: pages are painted by the processor, WebGL alone by SwiftShader
_SOFTWARE_FLAGS = (*(flag for flag in _FLAGS if not flag.startswith("--use-")), "--disable-gpu")


def find_chromium():
    """Path of an installed Chromium, or None."""
    return next((path for path in map(shutil.which, NAMES) if path), None)


def skip_without_chromium():
    """Skip the calling module without an installed Chromium."""
    if find_chromium() is None:
        names = ", ".join(NAMES)
        pytest.skip(
            f"no Chromium here (none of {names}): the report was not opened in a browser", allow_module_level=True
        )


class Chromium:
    """A browser with one page; records console messages and network requests.

    With `software`, pages are painted as on a machine without a graphics card: a frame with the live page's 3-D scene takes
    a tenth of the time.
    """

    def __init__(self, folder: Path, width=1280, height=800, *, software=False):
        self.requests, self.faults, self._count, self._rest = [], [], 0, b""
        theirs_in, self._out = os.pipe()
        self._in, theirs_out = os.pipe()
        command = [
            find_chromium(),
            *(_SOFTWARE_FLAGS if software else _FLAGS),
            f"--window-size={width},{height}",
            f"--user-data-dir={folder}",
            "about:blank",
        ]
        # the protocol wants its pipes as descriptors 3 and 4
        shell = f'exec 3<&{theirs_in} 4>&{theirs_out}; exec "$@"'
        self._process = subprocess.Popen(
            ["bash", "-c", shell, "bash", *command],
            pass_fds=(theirs_in, theirs_out),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(theirs_in)
        os.close(theirs_out)
        self._session = None
        target = self._ask("Target.getTargets")["targetInfos"]
        page = next(entry["targetId"] for entry in target if entry["type"] == "page")
        self._session = self._ask("Target.attachToTarget", targetId=page, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._ask(f"{domain}.enable")
        self.resize(width, height)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        try:
            self._session = None
            self._ask("Browser.close")
        except (OSError, TimeoutError, EOFError):
            self._process.kill()
        self._process.wait(20)
        os.close(self._in)
        os.close(self._out)

    def open(self, path: Path, limit_s=120.0):
        """Open a file and wait until the page reports ready; return the duration, s."""
        began = time.monotonic()
        self._ask("Page.navigate", url=path.resolve().as_uri())
        while not self.run("location.protocol === 'file:' && document.documentElement?.dataset.ready || ''"):
            if time.monotonic() - began > limit_s:
                raise TimeoutError(f"the page is not ready after {limit_s} s; console: {self.faults}")
            time.sleep(0.02)
        return time.monotonic() - began

    def close(self):
        """Leave the page for an empty one."""
        self._ask("Page.navigate", url="about:blank")

    def run(self, code):
        """Value of an expression in the page; a promise is awaited."""
        answer = self._ask("Runtime.evaluate", expression=code, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise AssertionError(f"{code}: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def settle(self):
        """Wait until the page has finished drawing."""
        self.run(
            "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 30))))"
        )

    def resize(self, width, height):
        """Size of the window, pixels."""
        self._ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def scheme(self, name):
        """Set the reader's preference: "light" or "dark"."""
        self._ask("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": name}])

    def pdf(self):
        """The printed page, as the bytes of a PDF file."""
        return base64.b64decode(self._ask("Page.printToPDF", printBackground=False)["data"])

    def mouse(self, kind, x, y, **options):
        """Move or press the mouse: "mouseMoved", "mousePressed", "mouseReleased"."""
        self._ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, **options)

    def picture(self):
        """Screenshot of the window, as the bytes of a PNG file."""
        return base64.b64decode(self._ask("Page.captureScreenshot", format="png")["data"])

    @contextlib.contextmanager
    def before_every_page(self, code):
        """Run a script before the page's own scripts in every page opened inside the context."""
        added = self._ask("Page.addScriptToEvaluateOnNewDocument", source=code)["identifier"]
        try:
            yield
        finally:
            self._ask("Page.removeScriptToEvaluateOnNewDocument", identifier=added)

    def _ask(self, method, **params):
        self._count += 1
        message = {"id": self._count, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._count:
                if "error" in answer:
                    raise AssertionError(f"{method}: {answer['error']}")
                return answer["result"]
            self._note(answer)

    def _next(self):
        deadline = time.monotonic() + 60.0
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._in], [], [], max(0.0, deadline - time.monotonic()))
            if not ready:
                raise TimeoutError("Chromium does not answer")
            part = os.read(self._in, 1 << 20)
            if not part:
                raise EOFError("Chromium has ended")
            self._rest += part
        message, self._rest = self._rest.split(b"\0", 1)
        return json.loads(message)

    def _note(self, event):
        method, params = event.get("method", ""), event.get("params", {})
        if method == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"])
        elif method == "Runtime.exceptionThrown":
            self.faults.append(str(params["exceptionDetails"]))
        elif method == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning", "assert"):
            self.faults.append(
                f"{params['type']}: {[arg.get('value', arg.get('description')) for arg in params['args']]}"
            )
        elif method == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
            text = params["entry"]["text"]
            if _DRIVER_MESSAGE not in text:
                self.faults.append(f"{params['entry']['level']}: {text}")

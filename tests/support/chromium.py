"""A headless Chromium, driven over its DevTools protocol."""

import asyncio
import base64
import itertools
import json
import shutil
import subprocess
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import aiohttp

TIMEOUT_SECONDS = 60.0
_FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-dev-shm-usage", "--no-proxy-server", "--remote-debugging-port=0",
    "--window-size=1280,800",
)  # fmt: skip
# Stores the terminal of the page in a global variable, so that a test can read its cells.
_HOOK = """
Object.defineProperty(Object.prototype, "terminal", {
  configurable: true,
  set(value) {
    Object.defineProperty(this, "terminal", {value, writable: true, configurable: true});
    if (value && value.buffer) window.shown = value;
  },
});
"""
_CELLS = """
window.shown ? Array.from({length: shown.rows}, (_, row) =>
  shown.buffer.active.getLine(row).translateToString(true)).join("\\n") : ""
"""


def missing_program() -> str | None:
    return None if shutil.which("chromium") else "chromium"


class Page:
    """A browser page; `requests` lists the requested addresses, `failures` the errors."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._socket = socket
        self._numbers = itertools.count(1)
        self._answers: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self.requests: list[str] = []
        self.failures: list[str] = []
        self._reader = asyncio.create_task(self._read())

    async def _read(self) -> None:
        async for message in self._socket:
            content = json.loads(message.data)
            if "id" in content:
                self._answers.pop(content["id"]).set_result(content)
            else:
                self._note(content["method"], content["params"])

    def _note(self, method: str, parameters: dict[str, Any]) -> None:
        if method == "Network.requestWillBeSent":
            self.requests.append(parameters["request"]["url"])
        elif method == "Network.webSocketCreated":
            self.requests.append(parameters["url"])
        elif method == "Network.loadingFailed":
            self.failures.append(parameters["errorText"])
        elif method == "Runtime.exceptionThrown":
            self.failures.append(parameters["exceptionDetails"]["text"])
        elif method == "Log.entryAdded" and parameters["entry"]["level"] == "error":
            self.failures.append(parameters["entry"]["text"])

    async def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a DevTools command and return its result."""
        number = next(self._numbers)
        answer = asyncio.get_running_loop().create_future()
        self._answers[number] = answer
        await self._socket.send_json({"id": number, "method": method, "params": parameters})
        response = await asyncio.wait_for(answer, TIMEOUT_SECONDS)
        assert "error" not in response, response
        return dict(response["result"])

    async def open(self, url: str) -> None:
        for domain in ("Page", "Network", "Runtime", "Log"):
            await self.call(f"{domain}.enable")
        await self.call("Page.addScriptToEvaluateOnNewDocument", source=_HOOK)
        await self.call("Page.navigate", url=url)

    async def evaluate(self, expression: str) -> Any:
        """The value of a JavaScript expression in the page."""
        response = await self.call("Runtime.evaluate", expression=expression, returnByValue=True)
        return response["result"].get("value")

    async def text(self) -> str:
        """The cells of the page's terminal."""
        return str(await self.evaluate(_CELLS))

    async def wait_for(self, expected: str) -> str:
        """Wait until the terminal's text contains `expected` and return the text."""
        limit = time.monotonic() + TIMEOUT_SECONDS
        while expected not in (text := await self.text()):
            if time.monotonic() > limit:
                raise AssertionError(f"timed out waiting for {expected!r}; the terminal:\n{text}")
            await asyncio.sleep(0.05)
        return text

    async def press(self, character: str) -> None:
        for kind in ("keyDown", "keyUp"):
            text = {"text": character} if kind == "keyDown" else {}
            await self.call("Input.dispatchKeyEvent", type=kind, key=character, **text)

    async def screenshot(self) -> bytes:
        """A PNG screenshot of the page."""
        response = await self.call("Page.captureScreenshot", format="png")
        return base64.b64decode(response["data"])


@asynccontextmanager
async def browser(profile: Path) -> AsyncIterator[Page]:
    """A page of a new browser with an empty profile folder."""
    command = ["chromium", *_FLAGS, f"--user-data-dir={profile}", "about:blank"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        port = await _port(profile, process)
        async with aiohttp.ClientSession() as session:
            async with session.get(f"http://127.0.0.1:{port}/json/list") as answer:
                targets = await answer.json()
            target = next(candidate for candidate in targets if candidate["type"] == "page")
            address = target["webSocketDebuggerUrl"]
            async with session.ws_connect(address, max_msg_size=1 << 26) as socket:
                yield Page(socket)
    finally:
        process.terminate()
        process.wait(20)


async def _port(profile: Path, process: subprocess.Popen[bytes]) -> int:
    file = profile / "DevToolsActivePort"
    limit = time.monotonic() + TIMEOUT_SECONDS
    while time.monotonic() < limit and process.poll() is None:
        if file.exists() and (lines := file.read_text().splitlines()):
            return int(lines[0])
        await asyncio.sleep(0.05)
    raise RuntimeError(f"chromium does not start (exit code {process.poll()})")

"""The application in a headless Chromium with access only to the loopback network."""

import asyncio
from urllib.parse import urlsplit

import pytest

from bench.support.processes import wait_until

pytest.importorskip("aiohttp")

from tests.support import chromium


async def _is_redrawn(page: chromium.Page, before: bytes) -> bool:
    """Whether the page changes soon; it is drawn in the next frame."""
    for _ in range(100):
        if await page.screenshot() != before:
            return True
        await asyncio.sleep(0.05)
    return False


async def _is_closed(page: chromium.Page) -> bool:
    """Whether the page soon shows that its session has ended."""
    for _ in range(100):
        if await page.evaluate("document.body.classList.contains('-closed')") is True:
            return True
        await asyncio.sleep(0.05)
    return False


async def test_keys_in_the_page_change_the_selection(serve, tmp_path):
    missing = chromium.missing_program()
    if missing:
        pytest.skip(f"{missing} is not installed")
    server = serve()
    async with chromium.browser(tmp_path / "profile") as page:
        await page.open(server.url)
        first = await page.wait_for("of 40")
        assert first.splitlines()[0].strip().startswith("tiny.s2r")
        assert await page.evaluate("document.title") == "tiny.s2r"
        await page.press("c")
        await page.wait_for("│ 40 of 40 │")
        before = await page.screenshot()
        await page.press("w")
        text = await page.wait_for("│ 6 of 40 │")
        assert "worst15" in text
        assert await _is_redrawn(page, before)
        hosts = {urlsplit(url).netloc for url in page.requests if not url.startswith("data:")}
        assert hosts == {f"127.0.0.1:{server.port}"}
        assert [url for url in page.requests if url.startswith("ws://")]
        assert page.failures == []
        assert await page.evaluate("document.fonts.check('16px Roboto Mono')") is True
        await page.press("q")
        assert wait_until(lambda: server.applications == [])
        assert await _is_closed(page)

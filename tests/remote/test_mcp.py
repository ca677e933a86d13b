"""The MCP server gives the answers of a folder for the same store on a web server."""

import asyncio

import pytest

pytest.importorskip("mcp")

from mcp import Client

from s2rtui.cli.mcp_server import build_server

CALLS = {"runs": {}, "query": {"expression": "worst15"}, "rooms": {}, "findings": {},
         "sql": {"query": "SELECT count(*) FROM pair"}, "figure": {"name": "map"},
         "instance": {"iid": 3, "heat": "occlusion:rgb"}}  # fmt: skip


def answers(store: str) -> dict[str, list[str]]:
    """What each tool gives, or the message of its failure."""

    async def asked() -> dict[str, list[str]]:
        async with Client(build_server(store)) as client:
            found = {name: await client.call_tool(name, words) for name, words in CALLS.items()}
            return {n: [part.model_dump_json() for part in r.content] for n, r in found.items()}

    return asyncio.run(asked())


def test_tools_read_a_store_on_a_web_server(served):
    remote = answers(served.url)
    assert remote == answers(str(served.path))
    assert "image/png" in remote["figure"][0]
    assert served.server.methods <= {"GET", "HEAD"}
    served.server.fail("CURRENT", "denied")
    assert all("access denied, 403" in text for [text] in answers(served.url).values())

"""The MCP server gives the answers of a folder for the same store on a web server."""

import asyncio

import pytest

pytest.importorskip("mcp")

from mcp import Client

from s2rtui.cli.mcp_server import build_server

CALLS = {"runs": {}, "query": {"expression": "worst15"}, "rooms": {}, "findings": {},
         "sql": {"query": "SELECT count(*) FROM pair"}, "figure": {"name": "map"},
         "instance": {"iid": 3, "heat": "occlusion:rgb"}}  # fmt: skip


def answers(store: str) -> dict[str, tuple[bool, list[str]]]:
    """Whether each tool fails, and what it gives."""

    async def asked() -> dict[str, tuple[bool, list[str]]]:
        async with Client(build_server(store)) as client:
            found = {name: await client.call_tool(name, words) for name, words in CALLS.items()}
            return {name: (result.is_error, [part.model_dump_json() for part in result.content])
                    for name, result in found.items()}  # fmt: skip

    return asyncio.run(asked())


def test_tools_read_a_store_on_a_web_server(served):
    remote = answers(served.url)
    assert remote == answers(str(served.path))
    assert not any(is_error for is_error, _ in remote.values())
    assert served.server.methods <= {"GET", "HEAD"}
    served.server.fail("CURRENT", "denied")
    for is_error, (text,) in answers(served.url).values():
        assert is_error
        assert "access denied, 403" in text

"""agents.py PROGRAM ASSETS: `cairn mcp` by the stock client of the Model Context Protocol (PyPI, mcp): each tool gives
the type that it states, a bake reports progress, a wrong scene is explained, and a call that is cancelled ends."""

import asyncio
import json
import pathlib
import subprocess
import sys
import tempfile
import time

import jsonschema
from mcp import ClientSession, StdioServerParameters
from mcp.client.stdio import stdio_client

program, assets = sys.argv[1:]
assets = pathlib.Path(assets).resolve()
TOOLS = {"check", "plan", "bake", "render", "rank", "analyse", "pack"}
scene = {
    "control": [str(assets / "cone-small.glb")],
    "props": [str(assets / "stick.glb")],
    "accuracy": "draft",
    "set": ["fill.count=12", "glue=natural"],
}


async def main(work):
    params = StdioServerParameters(command=program, args=["mcp", "--folder", str(work)])
    async with stdio_client(params) as (read, write), ClientSession(read, write) as session:
        await session.initialize()
        tools = {tool.name: tool for tool in (await session.list_tools()).tools}
        assert tools.keys() == TOOLS, tools.keys()

        async def call(name, arguments, **more):
            done = await session.call_tool(name, arguments, **more)
            assert not done.isError, done.content
            jsonschema.validate(done.structuredContent, tools[name].outputSchema)
            return done

        assert (await call("check", scene)).structuredContent["ok"]
        wrong = (await call("check", scene | {"props": [str(assets / "cone.glb")]})).structuredContent
        assert not wrong["ok"] and "larger than the control mesh" in wrong["problems"][0]["what"], wrong
        plan = (await call("plan", scene)).structuredContent
        assert plan["plan"]["expected_bodies"] == 12 and plan["most_result_bytes"]["glb"] > 0

        notes = []

        async def follow(progress, total, message):
            notes.append((progress, total, message))

        pile = str(work / "out" / "pile.glb")
        report = str(work / "out" / "pile.report.json")
        (work / "out").mkdir()
        bake = await call("bake", scene | {"output": pile, "report": report}, progress_callback=follow)
        assert 0 < bake.structuredContent["bodies"] <= 12 and "kept_shape" in bake.structuredContent["measures"]
        shares = [progress for progress, _, _ in notes]
        assert shares and shares == sorted(shares) and all(total == 1 for _, total, _ in notes), notes

        picture = await call("render", {"pile": pile, "output": str(work / "pile.png"), "size": "80x60"})
        assert [part.type for part in picture.content] == ["text", "image"]
        ranking = (await call("rank", {"folder": str(work / "out")})).structuredContent["ranking"]
        assert [entry["place"] for entry in ranking] == [1] and ranking[0]["figures"]["bodies"] > 0
        analysis = (
            await call("analyse", {"pile": str(assets / "stacks/table.glb"), "scenery": ["table"]})
        ).structuredContent
        assert analysis["stands"] and analysis["bodies"][0]["name"]
        pack = (await call("pack", {"pile": pile, "output": str(work / "pack")})).structuredContent
        assert {file["file"] for file in pack["files"]} >= {"static.lod0.glb", "skinned.glb"}

        # A name is never a flag, and what is missing is an error of the tool, not of the protocol.
        lost = await session.call_tool("render", {"pile": "--glue", "output": str(work / "no.png")})
        assert lost.isError and "no such file" in lost.content[0].text, lost.content
        print(f"cairn mcp: {len(tools)} tools, {len(notes)} notes of progress")


def cancel(work):
    """A bake that is cancelled ends its process, and leaves nothing behind."""
    command = [program, "mcp", "--folder", str(work)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:

        def send(method, **message):
            server.stdin.write(json.dumps({"jsonrpc": "2.0", "method": method} | message) + "\n")
            server.stdin.flush()

        def children():
            return pathlib.Path(f"/proc/{server.pid}/task/{server.pid}/children").read_text().split()

        def wait(until):
            end = time.monotonic() + 60
            while not until():
                assert time.monotonic() < end, "nothing happens"
                time.sleep(0.02)

        client = {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": {"name": "test", "version": "0"}}
        send("initialize", id=1, params=client)
        server.stdout.readline()
        send("notifications/initialized")
        # What is no JSON is answered, too.
        server.stdin.write('{"jsonrpc": "2.0", "id": 1,\n')
        server.stdin.flush()
        assert json.loads(server.stdout.readline())["error"]["code"] == -32700
        arguments = scene | {"accuracy": "reference", "set": [], "output": str(work / "late.glb")}
        send("tools/call", id=2, params={"name": "bake", "arguments": arguments})
        wait(children)
        send("notifications/cancelled", params={"requestId": 2})
        wait(lambda: not children())
        server.stdin.close()
        server.wait(60)
    assert not list(work.glob("late*"))


with tempfile.TemporaryDirectory() as folder:
    cancel(pathlib.Path(folder))
    asyncio.run(main(pathlib.Path(folder)))

"""The installed package against the program that came with it."""

import asyncio
import csv
import inspect
import json
import subprocess
import sys
from pathlib import Path

import cairn
import numpy as np
import pytest

HERE = Path(__file__).parent
CONTROL, STICK = "assets/cone-small.glb", "assets/stick.glb"
SCENE = {"control_mesh": CONTROL, "props": [STICK], "accuracy": "draft", "seed": 3, "fill": {"count": 12}}
FLAGS = ["--control", CONTROL, "--prop", STICK, "--accuracy", "draft", "--seed", "3", "--set", "fill.count=12"]


@pytest.fixture(scope="module")
def address():
    with cairn.serve() as address:
        yield address


def run(*arguments, code=0):
    done = subprocess.run([cairn.program(), *arguments], capture_output=True, text=True)
    assert done.returncode == code, done.stderr
    return done.stdout


def test_a_result_is_what_the_program_writes(address, tmp_path):
    bake = cairn.Client(address).bake(SCENE, format="csv")
    motion = bake.result()
    bake.save(tmp_path / "client.csv")
    run("bake", *FLAGS, "--quiet", "-o", str(tmp_path / "program.csv"), "--report", str(tmp_path / "report.json"))
    assert (tmp_path / "client.csv").read_bytes() == (tmp_path / "program.csv").read_bytes()
    # One bake gives every format.
    for name in ("client.usdc", "client.glb"):
        bake.save(tmp_path / name)
        own = name.replace("client", "program")
        run("bake", *FLAGS, "--quiet", "-o", str(tmp_path / own))
        assert (tmp_path / name).read_bytes() == (tmp_path / own).read_bytes()
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []
    report = json.loads((tmp_path / "report.json").read_text())
    assert bake.report()["result_blake3"] == report["result_blake3"] == bake.summary.result_blake3

    # The arrays are the table's numbers.
    frames, bodies = bake.summary.frame_count, bake.summary.body_count
    assert motion.positions.shape == (frames, bodies, 3) and motion.positions.dtype == np.float32
    assert motion.rotations.shape == (frames, bodies, 4) and motion.present.shape == (frames, bodies)
    with open(tmp_path / "client.csv", newline="") as file:
        rows = [row for row in csv.DictReader(line for line in file if not line.startswith("#"))]
    assert len(rows) == motion.present.sum()
    for row in (rows[0], rows[len(rows) // 2], rows[-1]):
        frame, body = int(row["frame"]), int(row["body"])
        position = [float(row[axis]) for axis in ("x_m", "y_m", "z_m")]
        np.testing.assert_allclose(motion.positions[frame, body], position, atol=1e-6)


def test_events_come_in_their_order(address):
    bake = cairn.Client(address).bake(SCENE, has_fill=True)
    kinds = [type(event).__name__ for event in bake]
    assert kinds[0] == "Accepted" and kinds[-1] == "Summary" and kinds.count("Snapshot") > 2
    assert len(bake.id) == 64 and bake.accepted.bake_id == bake.id
    # Come back to, by its id alone.
    again = cairn.Client(address).watch(bake.id)
    np.testing.assert_array_equal(again.result().positions, bake._bake._recording.motion().positions)


def test_a_plan_tells_what_it_would_cost(address):
    plan = cairn.Client(address).plan(SCENE).plan
    assert 0 < plan.expected_body_count <= 12 and len(plan.estimates) >= 5
    assert all(estimate.cpu_seconds > 0 for estimate in plan.estimates)
    assert cairn.Client(address).info().protocol_version == 1


def test_bakes_are_listed_and_deleted(address):
    client = cairn.Client(address)
    bake = client.bake(SCENE, seed=11, labels={"shot": "A010.v2: Höhle"})
    bake.result()
    found = list(client.list(labels={"shot": "A010.v2: Höhle"}, states=["succeeded"]))
    assert [one.bake_id for one in found] == [bake.id]
    assert bake.id in [one.bake_id for one in client.list()] and not list(client.list(owner="nobody"))
    status = client.get(bake.id[:10])
    assert status.bake_id == bake.id and status.summary.body_count == bake.summary.body_count
    client.delete(bake.id)
    with pytest.raises(cairn.Fault) as fault:
        client.get(bake.id)
    assert fault.value.reason == "BAKE_NOT_FOUND"
    with pytest.raises(cairn.Fault, match="no state"):
        list(client.list(states=["done"]))
    with pytest.raises(cairn.Fault, match=r"none\.pem"):
        cairn.Client("127.0.0.1:1", identity=("none.pem", "none.key")).info()


def test_everything_wrong_is_told_at_once(address):
    with pytest.raises(cairn.Fault) as fault:
        cairn.read({"control_mesh": "none.glb", "props": ["nothing.glb"]})
    assert len(fault.value.problems) == 2 and "none.glb" in fault.value.problems[0].text
    with pytest.raises(cairn.Fault, match="weight"):
        cairn.read(SCENE, props=[{"path": STICK, "wieght": 2}])
    with pytest.raises(cairn.Fault) as fault:
        cairn.Client(address).bake({**SCENE, "control_mesh": STICK, "props": [CONTROL]}).result()
    assert fault.value.reason == "SCENE_INVALID" and fault.value.problems
    with pytest.raises(cairn.Fault, match="cannot be reached"):
        cairn.Client("127.0.0.1:1").info()
    with pytest.raises(cairn.Fault, match="HOST:PORT"):
        cairn.Client("nowhere").info()


def test_a_scene_file_means_what_the_program_makes_of_it():
    request = cairn.read("sticks.toml", seed=9, control="off")
    scene = json.loads(run("scene", "sticks.toml", "--set", "seed=9", "--set", "control=off", "--json"))
    assert request.spec.scene.seed == scene["seed"] == 9
    assert [prop.path for prop in request.spec.scene.props] == [prop["path"] for prop in scene["props"]]
    assert {asset.sha256 for asset in request.spec.assets} == set(request.contents)


def test_asyncio_bakes_and_cancels(address):
    async def work():
        client = cairn.AsyncClient(address)
        quick = client.bake(SCENE)
        motion = await quick.result()
        long = client.bake("ball.toml", accuracy="reference")
        with pytest.raises(cairn.Fault) as fault:
            async for event in long:
                if isinstance(event, cairn.asynchronous.Progress):
                    await long.cancel()
        return motion, fault.value.reason

    motion, reason = asyncio.run(work())
    assert motion.present.all() and reason == "BAKE_CANCELLED"


def test_a_client_that_waits_works_inside_a_running_loop(address):
    async def work():
        return cairn.Client(address).info()

    assert asyncio.run(work()).versions.cairn


@pytest.mark.parametrize("script", sorted((HERE / "python").glob("*.py")), ids=lambda path: path.name)
def test_an_example_runs(script, tmp_path):
    assert len(script.read_text().splitlines()) < 30
    output = tmp_path / "pile.glb"
    arguments = [CONTROL, STICK] if script.name == "plan.py" else ["sticks.toml", output]
    done = subprocess.run([sys.executable, script, *arguments], cwd=HERE, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "bodies" in done.stdout
    assert script.name == "plan.py" or output.read_bytes()[:4] == b"glTF"


def test_all_that_is_public_is_described():
    for name in cairn.__all__:
        thing = getattr(cairn, name)
        assert inspect.getdoc(thing), name
        for member, value in vars(thing).items() if inspect.isclass(thing) else ():
            if inspect.isfunction(value) and not member.startswith("_"):
                assert inspect.getdoc(value), f"{name}.{member}"


def test_both_clients_have_the_same_calls():
    def calls(kind):
        return {name for name in vars(kind) if not name.startswith("_")}

    assert calls(cairn.Client) == calls(cairn.AsyncClient)
    for name in calls(cairn.Client):
        ours, theirs = (inspect.signature(getattr(kind, name)) for kind in (cairn.Client, cairn.AsyncClient))
        assert list(ours.parameters) == list(theirs.parameters), name


def test_what_holds_what(address):
    table = "assets/stacks/table.glb"
    answers = cairn.analyse(table, scenery=["table"])
    bodies = {body["name"]: body for body in answers["bodies"]}
    assert answers["stands"] and bodies["bread"]["removal"]["is_safe"]
    assert not bodies["jug"]["removal"]["is_safe"], "it holds the board down"
    assert cairn.analyse(table, scenery=["table"], without=["jug"])["stands"] is False
    with pytest.raises(cairn.Fault, match="no node has the name"):
        cairn.analyse(table, scenery=["chair"])
    far = cairn.Client(address).analyse(table, scenery=["table"])
    assert [body.name for body in far.bodies] == list(bodies) and far.pile.stands
    assert [body.load for body in far.bodies] == [body["load"] for body in bodies.values()]
    with pytest.raises(cairn.Fault) as refused:
        cairn.Client(address).analyse(table, scenery=["chair"])
    assert refused.value.reason == "SCENE_INVALID" and "no node has the name" in refused.value.problems[0].text

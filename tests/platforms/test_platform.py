"""A program that was built for another platform gives what this machine's own gives, and fails as it does."""

import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ASSETS = ROOT / "examples" / "assets"
OWN = ROOT / "target" / "release" / "cairn"
PROGRAM, TARGET = os.environ["CAIRN_PROGRAM"], os.environ["CAIRN_TARGET"]
RUNS = [*os.environ["CAIRN_RUNS"].split(), PROGRAM]
ON_WINDOWS = "windows" in TARGET
# In QEMU a bake takes some twenty times as long.
IS_SLOW = "qemu" in RUNS[0]
TIMEOUT_S = 3600 if IS_SLOW else 600
# Small bakes of each kind: held, glued, stacked; and poured, of props with parts, without glue. One is larger: in small
# ones, platforms that round differently agree by luck.
SCENES = {
    "held": ["sticks.toml", "--set", "fill.count=40", "--set", "control=hold"],
    "glued": ["ball.toml", "--set", "fill.count=40", "--set", "glue=as_modelled"],
    "glued, in clusters": ["sticks.toml", "--set", "glue=as_modelled"],
    "stacked": ["books.toml", "--set", "fill.count=40"],
    "poured": ["guide/pour.toml", "--set", "fill.count=30"],
}
STICKS = ["--control", "cone-small.glb", "--prop", "stick.glb", "--accuracy", "draft", "--set", "fill.count=12"]


def run(program, arguments, cwd, code=0):
    command = [*program, *map(str, arguments)]
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, errors="replace", timeout=TIMEOUT_S)
    assert done.returncode == code, (command, done.returncode, done.stdout[-2000:], done.stderr[-4000:])
    return done


def in_its_words(path):
    """A path as one writes it on the platform."""
    return "Z:" + str(path).replace("/", "\\") if ON_WINDOWS else str(path)


@pytest.fixture
def desk(tmp_path):
    for name in ("cone-small.glb", "stick.glb", "dome.glb", "book.glb"):
        shutil.copy(ASSETS / name, tmp_path)
    return tmp_path


def bytes_of(folder):
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.glob("*.*"))}


def test_doctor(tmp_path):
    printed = json.loads(run(RUNS, ["doctor", "--json"], tmp_path).stdout)
    assert printed


@pytest.mark.parametrize("name", SCENES)
def test_hashes(name, tmp_path):
    scene, *flags = SCENES[name]
    flags += ["--accuracy", "draft", "--no-cache", "--quiet"]
    made = []
    for kind, program in (("own", [OWN]), ("other", RUNS)):
        folder = tmp_path / kind
        folder.mkdir()
        for output in ("pile.glb", "pile.usda"):
            run(program, ["bake", f"{ROOT}/examples/{scene}", *flags, "-o", folder / output], tmp_path)
        small = ["--size", "160x120", "--samples", "4"]
        run(program, ["render", folder / "pile.glb", "-o", folder / "pile.png", *small], tmp_path)
        made.append(bytes_of(folder))
    with (ROOT / "target/cross/hashes.tsv").open("a") as table:
        table.writelines(f"{TARGET}\t{name}\t{file}\t{sha256}\n" for file, sha256 in made[1].items())
    assert made[0] == made[1] and len(made[0]) == 3


def test_several_threads_give_the_same_bytes(desk):
    for threads in ("1", "4"):
        run(RUNS, ["bake", *STICKS, "--quiet", "--no-cache", "--threads", threads, "-o", f"{threads}.glb"], desk)
    assert (desk / "1.glb").read_bytes() == (desk / "4.glb").read_bytes()


def test_bad_input_names_what_to_do(desk):
    (desk / "broken.glb").write_bytes(b"glTF\x02\0\0\0 and no more")
    wrong = ["--control", "broken.glb", "--prop", "nowhere.glb", "--prop", "stick.glb"]
    printed = run(RUNS, ["bake", *wrong, "-o", "pile.glb"], desk, code=65).stderr
    assert "broken.glb" in printed and "nowhere.glb" in printed
    assert printed == run([OWN], ["bake", *wrong, "-o", "pile.glb"], desk, code=65).stderr
    assert run(RUNS, ["bake", "--no-such-flag"], desk, code=2).stderr
    assert not (desk / "pile.glb").exists()


@pytest.mark.parametrize("folder", ["with spaces", "Größe 山 🍌", "deep/" + "/".join(["a" * 60] * 6)])
def test_paths(folder, desk):
    place = desk / folder
    place.mkdir(parents=True)
    for name in ("cone-small.glb", "stick.glb"):
        shutil.copy(desk / name, place)
    inputs = ["--control", in_its_words(place / "cone-small.glb"), "--prop", in_its_words(place / "stick.glb")]
    run(RUNS, ["bake", *inputs, *STICKS[4:], "--quiet", "--no-cache", "-o", in_its_words(place / "pile.glb")], desk)
    run([OWN], ["bake", *STICKS, "--quiet", "--no-cache", "-o", desk / "own.glb"], desk)
    assert (place / "pile.glb").read_bytes() == (desk / "own.glb").read_bytes()
    # As a scene file, whose paths are relative to it; and what it made is a scene, too. No program of Windows starts in
    # a folder whose path is as long as the last one.
    (place / "pile.toml").write_text(run(RUNS, ["scene", *STICKS], desk).stdout)
    run(
        RUNS,
        ["bake", in_its_words(place / "pile.toml"), "--quiet", "--no-cache", "-o", in_its_words(place / "again.glb")],
        desk,
    )
    run(RUNS, ["verify", in_its_words(place / "again.glb")], desk)


def test_batch_goes_on_where_it_ended(desk):
    run(RUNS, ["scene", *STICKS], desk)
    (desk / "pile.toml").write_text(run(RUNS, ["scene", *STICKS], desk).stdout)
    matrix = ["batch", "pile.toml", "--seeds", "0..2", "-o", "out/{seed}.glb"]
    run(RUNS, matrix, desk)
    before = bytes_of(desk / "out")
    assert sum(name.endswith(".glb") for name in before) == 3
    (desk / "out" / "1.glb").unlink()
    run(RUNS, matrix, desk)
    assert {name: value for name, value in bytes_of(desk / "out").items() if name.endswith(".glb")} == {
        name: value for name, value in before.items() if name.endswith(".glb")
    }


class Server:
    def __init__(self, folder):
        command = [*RUNS, "serve", "--listen", "127.0.0.1:0", "--data", str(folder / "data"), "--drain-seconds", "0"]
        self.log = open(folder / "log", "ab")
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=self.log, text=True, cwd=folder)
        self.address = self.process.stdout.readline().strip()
        assert self.address, (folder / "log").read_text()

    def end(self, sign=signal.SIGTERM):
        self.process.send_signal(sign)
        return self.process.wait(60)


@pytest.fixture(scope="session")
def messages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("messages")
    compiler = [sys.executable, "-m", "grpc_tools.protoc", "-I", ROOT / "proto"]
    protos = sorted((ROOT / "proto" / "cairn" / "v1").glob("*.proto"))
    subprocess.run([*compiler, f"--python_out={folder}", f"--grpc_python_out={folder}", *protos], check=True)
    return folder


def test_a_stock_client(desk, messages):
    server = Server(desk)
    command = [sys.executable, ROOT / "examples" / "client.py", "cone-small.glb", "stick.glb", "--server"]
    command += [server.address, "-o", "client.glb"]
    subprocess.run(command, cwd=desk, check=True, env={**os.environ, "PYTHONPATH": str(messages)}, timeout=TIMEOUT_S)
    server.end()
    run([OWN], ["bake", *STICKS[:-2], "--quiet", "--no-cache", "-o", "own.glb"], desk)
    assert (desk / "client.glb").read_bytes() == (desk / "own.glb").read_bytes()


def test_a_killed_server_resumes(desk):
    long = ["bake", "--control", "dome.glb", "--prop", "book.glb", "--accuracy", "draft", "--set", "fill.count=150"]
    server = Server(desk)
    bake = subprocess.Popen(
        [OWN, *long, "--server", server.address, "-o", "far.glb"], cwd=desk, stderr=subprocess.PIPE, text=True
    )
    time.sleep(30 if IS_SLOW else 4)
    server.process.kill()
    server.process.wait()
    printed = bake.communicate(timeout=TIMEOUT_S)[1]
    found = re.search(r"`cairn watch ([0-9a-f]+)", printed)
    server = Server(desk)
    if bake.returncode != 0:
        assert found, printed
        run([OWN], ["watch", found[1], "--server", server.address, "-o", "far.glb"], desk)
    server.end()
    run([OWN], [*long, "--quiet", "--no-cache", "-o", "own.glb"], desk)
    assert (desk / "far.glb").read_bytes() == (desk / "own.glb").read_bytes()


def test_an_interrupted_bake_leaves_nothing(desk):
    long = ["bake", "--control", "dome.glb", "--prop", "book.glb", "--accuracy", "reference", "-o", "pile.glb"]
    before = bytes_of(desk)
    bake = subprocess.Popen([*RUNS, *long], cwd=desk, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    time.sleep(6)
    bake.send_signal(signal.SIGINT)
    assert bake.wait(60) == 130
    assert bytes_of(desk) == before


@pytest.fixture
def small_disk(tmp_path):
    place = tmp_path / "disk"
    place.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=16k", "tmpfs", place], capture_output=True).returncode:
        pytest.skip("no file system can be mounted here")
    yield place
    subprocess.run(["umount", place], check=True)


@pytest.mark.skipif(ON_WINDOWS, reason="Wine reports no full disk to a program")
def test_a_full_disk_is_named(desk, small_disk):
    printed = run(RUNS, ["bake", *STICKS, "--quiet", "--no-cache", "-o", small_disk / "pile.glb"], desk, code=75).stderr
    assert "pile.glb" in printed
    assert list(small_disk.iterdir()) == []

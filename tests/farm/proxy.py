"""examples/farm/haproxy.cfg in front of two real servers: bakes go to both, the same request to the same one; a
server that is gone, or takes no more bakes, is passed by.

proxy.py PROGRAM      with haproxy on this machine, and hyperframe and hpack in this Python
"""

import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import hpack
from hyperframe.frame import DataFrame, HeadersFrame, SettingsFrame

ROOT = Path(__file__).resolve().parents[2]
CONFIG = (ROOT / "examples" / "farm" / "haproxy.cfg").read_text()
ASSETS = ROOT / "examples" / "assets"
SCENE = ["--control", ASSETS / "cone-small.glb", "--prop", ASSETS / "stick.glb", "--quiet"]
QUICK = [*SCENE, "--accuracy", "draft", "--set", "fill.count=8"]
# Timeout of a step, s. It measures nothing.
LIMIT = 60


def health_check():
    """The bytes of a call of grpc.health.v1.Health/Check with an empty request."""
    headers = [(":method", "POST"), (":scheme", "http"), (":path", "/grpc.health.v1.Health/Check")]
    headers += [(":authority", "cairn"), ("content-type", "application/grpc"), ("te", "trailers")]
    call = HeadersFrame(1, hpack.Encoder().encode(headers), flags=["END_HEADERS"])
    body = DataFrame(1, bytes(5), flags=["END_STREAM"])
    frames = b"".join(frame.serialize() for frame in (SettingsFrame(0), call, body))
    return b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + frames


def main(program):
    assert health_check().hex() in CONFIG, f"the health check's bytes are {health_check().hex()}"
    front, *backs = free_ports(3)
    config = CONFIG.replace("127.0.0.1:50151\n", f"127.0.0.1:{front}\n").replace(":50151 proto", f":{front} proto")
    for number, port in zip((50161, 50162), backs):
        config = config.replace(
            f"server {'one' if number == 50161 else 'two'} 127.0.0.1:{number}", f"server s{port} 127.0.0.1:{port}"
        )
    with tempfile.TemporaryDirectory(prefix="cairn-proxy-") as work:
        work = Path(work)
        (work / "haproxy.cfg").write_text(config)
        servers = [serve(program, work, port) for port in backs]
        proxy = subprocess.Popen(["haproxy", "-f", work / "haproxy.cfg"], stderr=open(work / "proxy.log", "wb"))
        try:
            check(program, work, f"127.0.0.1:{front}", servers, backs)
        finally:
            for process in (proxy, *servers):
                process.kill()
                process.wait()


def check(program, work, address, servers, ports):
    def bake(seed, *more, scene=QUICK):
        command = [program, "bake", *scene, "--seed", str(seed), "-o", work / f"{seed}.glb", *more]
        return subprocess.run(command, capture_output=True, text=True)

    def through(seed, *more):
        done = bake(seed, "--server", address, *more)
        assert done.returncode == 0, done.stderr
        return (work / f"{seed}.glb").read_bytes()

    def kept():
        return [len(list((work / str(port) / "bakes").glob("*"))) for port in ports]

    wait_for("the proxy", lambda: bake(0, "--server", address).returncode == 0)
    seeds = range(8)
    first = [through(seed) for seed in seeds]
    assert sum(kept()) == len(seeds) and min(kept()) > 0, kept()
    assert [through(seed) for seed in seeds] == first and sum(kept()) == len(seeds), "baked again"
    for seed in seeds:
        assert bake(seed).returncode == 0
        assert (work / f"{seed}.glb").read_bytes() == first[seed], "not as without a server"

    # Come back to by the route that it was asked with.
    long = [*SCENE, "--accuracy", "reference", "--set", "fill.count=200", "--server", address, "--route", "a010"]
    long[long.index("--quiet")] = "--progress=plain"
    runs = subprocess.Popen([program, "bake", *long, "-o", work / "long.glb"], stderr=subprocess.PIPE, text=True)
    bake_id = runs.stderr.readline().split()[1]
    busy = next(n for n, port in enumerate(ports) if (work / str(port) / "bakes" / bake_id).exists())

    # A server that finishes its bakes and takes no more says so, and is passed by.
    servers[busy].send_signal(signal.SIGTERM)
    wait_for("the proxy to see it", lambda: f"s{ports[busy]} is DOWN" in (work / "proxy.log").read_text())
    assert servers[busy].poll() is None, "it has a bake"
    assert "Layer7" in (work / "proxy.log").read_text(), "seen by its own word, not by a broken connection"
    before = kept()[1 - busy]
    through(50, "--route", "a010")
    assert kept()[1 - busy] == before + 1
    runs.kill()
    runs.communicate()
    servers[busy].kill()

    # One is gone: all goes on. Both are: try again.
    assert [through(seed) for seed in seeds] == first
    servers[1 - busy].kill()
    wait_for("the proxy to see it", lambda: "has no server available" in (work / "proxy.log").read_text())
    assert bake(0, "--server", address).returncode == 75
    print("proxy: bakes on both servers, each once; one that drains and one that is gone are passed by")


def serve(program, work, port):
    command = [program, "serve", "--listen", f"127.0.0.1:{port}", "--data", work / str(port)]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=open(work / f"{port}.log", "wb"), text=True)
    assert server.stdout.readline(), (work / f"{port}.log").read_text()
    return server


def free_ports(count):
    sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [probe.getsockname()[1] for probe in sockets]
    for probe in sockets:
        probe.close()
    return ports


def wait_for(what, is_so):
    until = time.monotonic() + LIMIT
    while not is_so():
        assert time.monotonic() < until, f"this did not come: {what}"
        time.sleep(0.2)


if __name__ == "__main__":
    main(str(Path(sys.argv[1]).resolve()))

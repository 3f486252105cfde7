"""three.py CHROMIUM NODE_MODULES FOLDER: three.js in a browser puts every body of FOLDER/pile.glb where the table has it."""

import http.server
import json
import pathlib
import subprocess
import sys
import tempfile
import threading

import table as tables

SECONDS = 180  # until a browser that does not answer is given up

chromium, modules, work = sys.argv[1:]
table = tables.load(f"{work}/pile.json")
answer = []
answered = threading.Event()


class Handler(http.server.SimpleHTTPRequestHandler):
    def translate_path(self, path):
        top, _, rest = path.split("?")[0].lstrip("/").partition("/")
        folder = {"modules": modules, "work": work}.get(top)
        return str(pathlib.Path(folder, rest) if folder else pathlib.Path(__file__).with_name("three.html"))

    def do_POST(self):
        answer.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
        self.send_response(204)
        self.end_headers()
        answered.set()

    def log_message(self, *_):
        pass


Handler.extensions_map = {**Handler.extensions_map, ".js": "text/javascript"}
server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
threading.Thread(target=server.serve_forever, daemon=True).start()
with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
    frames = ",".join(map(str, tables.frames(table)))
    browser = subprocess.Popen(
        [
            chromium,
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            f"--user-data-dir={profile}",
            f"http://127.0.0.1:{server.server_port}/?fps={table['fps']}&frames={frames}",
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        if not answered.wait(SECONDS):
            raise SystemExit("three.js: the browser gave no answer")
    finally:
        browser.terminate()
        browser.wait()
if "error" in answer[0]:
    raise SystemExit(f"three.js: {answer[0]['error']}")

# Columns first, as three.js keeps matrices.
poses = {}
for frame, nodes in zip(tables.frames(table), answer[0]["frames"]):
    for body, entry in enumerate(table["bodies"]):
        columns = nodes[entry["name"]]
        poses[frame, body] = [[columns[4 * c + r] for c in range(4)] for r in range(4)]
tables.compare(f"three.js {answer[0]['revision']}", table, poses)

"""A page in a browser without a screen, and what it sends home."""

import http.server
import json
import pathlib
import subprocess
import tempfile
import threading

SECONDS = 180  # until a browser that does not answer is given up


def ask(chromium, files, page, flags=()):
    """What this page posts to /answer: an address on a server of its own, for which `files` gives the file or the bytes of a
    path; or that of a file on the disk, in which {port} becomes the server's port."""
    answer = []
    answered = threading.Event()

    class Handler(http.server.BaseHTTPRequestHandler):
        types = {".js": "text/javascript", ".html": "text/html"}

        def do_GET(self):
            path = self.path.split("?")[0]
            found = files(path)
            if isinstance(found, pathlib.Path):
                found = found.read_bytes() if found.is_file() else None
            self.send_response(404 if found is None else 200)
            self.send_header("Content-Type", self.types.get(pathlib.Path(path).suffix, "text/html"))
            self.end_headers()
            self.wfile.write(found or b"")

        def do_POST(self):
            answer.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()
            answered.set()

        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        here = page.startswith("file:")
        address = page.format(port=server.server_port) if here else f"http://127.0.0.1:{server.server_port}/{page}"
        command = [chromium, "--headless", "--no-sandbox", "--disable-dev-shm-usage", *flags]
        browser = subprocess.Popen(
            [*command, f"--user-data-dir={profile}", address], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            if not answered.wait(SECONDS):
                raise SystemExit(f"{page}: the browser gave no answer")
        finally:
            browser.terminate()
            browser.wait()
    if "error" in answer[0]:
        raise SystemExit(f"{page}: {answer[0]['error']}")
    return answer[0]

"""sheet.py CHROMIUM PAGE: a contact sheet, opened from the disk, shows its first result and moves it, with no error."""

import html.parser
import pathlib
import subprocess
import sys
import tempfile

SECONDS = 180  # until a browser that does not answer is given up

# How many frames a browser without a screen draws is not to be relied on: somebody moves the slider to the middle.
MOVES = """<script>
  const wait = setInterval(() => {
    if (document.body.dataset.shown === undefined) return;
    clearInterval(wait);
    const seek = document.getElementById("seek");
    seek.value = seek.max / 2;
    seek.dispatchEvent(new Event("input"));
  }, 100);
</script>"""

chromium, page = sys.argv[1:]


class Page(html.parser.HTMLParser):
    """The body's attributes, and how many results there are to choose."""

    body: dict[str, str | None] = {}
    tiles = 0

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        if tag == "body":
            self.body = attrs
        self.tiles += attrs.get("class") == "tile"


with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
    moved = pathlib.Path(profile, "moved.html")
    moved.write_text(pathlib.Path(page).read_text() + MOVES)
    done = subprocess.run(
        [
            chromium,
            "--headless",
            "--no-sandbox",
            "--disable-dev-shm-usage",
            "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
            "--enable-logging=stderr",
            f"--user-data-dir={profile}",
            # Without a picture to make, it draws nothing.
            "--virtual-time-budget=8000",
            f"--screenshot={profile}/page.png",
            "--dump-dom",
            moved.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=SECONDS,
    )
found = Page()
found.feed(done.stdout)
errors = [line for line in done.stderr.splitlines() if "CONSOLE" in line and ("Uncaught" in line or "Error" in line)]
if errors or found.tiles < 2 or found.body.get("data-shown") != "0" or not float(found.body.get("data-time") or 0) > 0:
    raise SystemExit(f"contact sheet: {found.tiles} results, {found.body}, {errors}")
print(f"contact sheet: {found.tiles} results; the first one moves")

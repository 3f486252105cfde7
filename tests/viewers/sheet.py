"""sheet.py CHROMIUM PAGE: a contact sheet, opened from the disk, shows its first result and moves it, with no error."""

import pathlib
import sys
import tempfile

import browser

# Before the page's own scripts: its errors. After them: once a result is shown, somebody moves the slider to the middle.
ERRORS = """<script>
  const send = (answer) =>
    fetch(`http://127.0.0.1:${location.hash.slice(1)}/answer`, { method: "POST", mode: "no-cors", body: JSON.stringify(answer) });
  addEventListener("error", (event) => send({ error: event.message }));
  addEventListener("unhandledrejection", (event) => send({ error: String(event.reason) }));
</script>"""
MOVES = """<script>
  let moved = false;
  const wait = setInterval(() => {
    const { shown, time } = document.body.dataset;
    if (shown === undefined) return;
    if (!moved) {
      const seek = document.getElementById("seek");
      seek.value = seek.max / 2;
      seek.dispatchEvent(new Event("input"));
      moved = true;
    } else if (time > 0) {
      clearInterval(wait);
      send({ shown, tiles: document.getElementsByClassName("tile").length });
    }
  }, 100);
</script>"""

chromium, page = sys.argv[1:]
with tempfile.TemporaryDirectory() as folder:
    watched = pathlib.Path(folder, "watched.html")
    language = '<html lang="en">'
    text = pathlib.Path(page).read_text()
    assert text.count(language) == 1
    watched.write_text(text.replace(language, language + ERRORS) + MOVES)
    flags = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    found = browser.ask(chromium, lambda _: None, watched.as_uri() + "#{port}", flags)
if found["tiles"] < 2 or found["shown"] != "0":
    raise SystemExit(f"contact sheet: {found}")
print(f"contact sheet: {found['tiles']} results; the first one moves")

"""How studies read what their programs print, and write their pages."""

import datetime
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
WRAP = ROOT / "target/tools/bin/rumdl"


def rows(text):
    """The rows of the Markdown table in a text, each by the table's column names."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    names, _, *cells = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)
    return [dict(zip(names, row)) for row in cells]


def commit():
    """The last commit that changed the code."""
    last = ["git", "log", "-1", "--abbrev=8", "--format=%h", "--", "server", "proto", "Cargo.lock", ":!*.md"]
    return subprocess.run(last, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()


def stamp():
    """When a page was measured, and with which code. `tests/evidence` reads the day."""
    return f"Measured on {datetime.date.today().isoformat()}, at commit {commit()}."


def write_measured(path, text):
    """The page of a study that was measured just now."""
    write(path, f"{text}\n{stamp()}\n")


def write(path, text):
    """The page's lines are wrapped like those of all pages, where the tool for it is there."""
    path.write_text(text)
    if WRAP.exists():
        subprocess.run([WRAP, "fmt", "--quiet", path], check=True)

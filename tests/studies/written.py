"""How studies write their pages."""

import subprocess
from pathlib import Path

WRAP = Path(__file__).resolve().parents[2] / "target/tools/bin/rumdl"


def write(path, text):
    """The page's lines are wrapped like those of all pages, where the tool for it is there."""
    path.write_text(text)
    if WRAP.exists():
        subprocess.run([WRAP, "fmt", "--quiet", path], check=True)

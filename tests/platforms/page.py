"""What the platforms' bakes and files are, written into the page on installing.

    python3 tests/platforms/page.py

after `.ci/cross`, `.ci/release` and `tests/platforms/run` for all platforms that run here.
"""

import datetime
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/studies"))
import written  # noqa: E402

PAGE = ROOT / "examples/guide/install.md"
BUILT = ROOT / "target/cross"
ADDONS = ROOT / "target/release-archives"
# In the order of the page's columns, with the add-on's name for each.
PLATFORMS = {
    "x86_64-unknown-linux-gnu": "linux-x64",
    "x86_64-pc-windows-gnu": "windows-x64",
    "aarch64-unknown-linux-gnu": "linux-arm64",
}


def hashes():
    """The hash of each scene's `pile.glb`, the same on all platforms."""
    found = {}
    for line in (BUILT / "hashes.tsv").read_text().splitlines():
        target, scene, file, digest = line.split("\t")
        if file == "pile.glb":
            found.setdefault(scene, {})[target] = digest[:16]
    for scene, by_target in found.items():
        if set(by_target) != set(PLATFORMS):
            sys.exit(f"{scene} was baked on {', '.join(by_target)} alone: tests/platforms/run, for all that run here")
        if len(set(by_target.values())) != 1:
            sys.exit(f"{scene} has other bytes on another platform: {by_target}")
    return {scene: min(by_target.values()) for scene, by_target in found.items()}


def megabytes(paths):
    return " | ".join(f"{path.stat().st_size / 1e6:.1f}" for path in paths)


def program(target):
    return BUILT / target / ("cairn.exe" if "windows" in target else "cairn")


def addon(name):
    return next(ADDONS.glob(f"cairn-blender-*-{name}.zip"))


def main():
    text = PAGE.read_text()
    rows = {f"| {scene} |": f" `{digest}` |" for scene, digest in hashes().items()}
    rows["| program, MB |"] = f" {megabytes(map(program, PLATFORMS))} |"
    rows["| add-on with it, MB |"] = f" {megabytes(map(addon, PLATFORMS.values()))} |"
    for begin, end in rows.items():
        text, count = re.subn(rf"(?m)^{re.escape(begin)}.*$", begin + end, text)
        assert count == 1, begin
    today = datetime.date.today().isoformat()
    text, count = re.subn(r"On [\d-]+, at commit \w+,", f"On {today}, at commit {written.commit()},", text)
    assert count == 1
    written.write(PAGE, text)


if __name__ == "__main__":
    main()

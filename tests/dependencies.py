#!/usr/bin/env python3
"""Holds `server/dependencies.md` against the crates that are there, and a fresh resolution against the lock file.

    tests/dependencies.py            checks
    tests/dependencies.py --write    writes the page's counts first

A build without the lock file takes the newest versions that each crate accepts. Where a crate of ours and one that it
uses would then bring two versions of a third, their types may meet and not fit: such crates are named. Nothing is
built. The crates' index comes from the network.
"""

import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "server" / "dependencies.md"
MOST = 384
MARK = r"(<!-- {}: -->).*?(<!-- end -->)"


def run(*command, folder=ROOT):
    done = subprocess.run(command, cwd=folder, text=True, capture_output=True)
    if done.returncode:
        sys.exit(f"{' '.join(command)}: {done.stderr.strip()}")
    return done.stdout


def compiled(*target):
    """Name and version of all crates from elsewhere that the program and its build have."""
    kinds = ("--edges", "normal,build", "--package", "cairn", "--prefix", "none")
    lines = run("cargo", "tree", "--locked", *kinds, *target).splitlines()
    return {tuple(line.split()[:2]) for line in lines if line and not line.startswith("cairn")}


class Resolution:
    """Which crate uses which, without the dependencies of tests."""

    def __init__(self, folder, *flags):
        found = json.loads(run("cargo", "metadata", "--format-version", "1", *flags, folder=folder))
        self.packages = {package["id"]: package for package in found["packages"]}
        self.own = [id for id, package in self.packages.items() if package["source"] is None]
        self.uses = {}
        for node in found["resolve"]["nodes"]:
            kinds = ((use["pkg"], {kind["kind"] for kind in use["dep_kinds"]}) for use in node["deps"])
            self.uses[node["id"]] = {id for id, kind in kinds if kind & {None, "build"}}

    def name(self, id):
        return self.packages[id]["name"]

    def version(self, id):
        return "v" + self.packages[id]["version"]

    def direct(self):
        """The crates that ours name."""
        return {id for own in self.own for id in self.uses[own] if self.packages[id]["source"]}

    def reached(self, start, among, without=()):
        seen, left = {start}, [start]
        while left:
            at = left.pop()
            for id in self.uses[at] - seen:
                is_cut = at in self.own and self.name(id) in without
                if (id in self.own or (self.name(id), self.version(id)) in among) and not is_cut:
                    seen.add(id)
                    left.append(id)
        return seen

    def meetings(self):
        """(ours, crate, its version beside ours): two versions of a crate that ours names, one of them named by a crate
        beside it."""
        beside = {}
        for id in self.direct():
            beside.setdefault(self.name(id), set()).add(self.version(id))
        return {
            (self.name(id), self.name(used), self.version(used))
            for id in self.direct()
            for used in self.uses[id]
            if self.name(used) in beside and self.version(used) not in beside[self.name(used)]
        }


def rows(text):
    """The crates of each row of the page's tables, and the row."""
    for line in text.splitlines():
        if line.startswith("| `"):
            yield re.findall(r"`([\w-]+)`", line.split("|")[1]), line


def counted(text, locked):
    everywhere, here = compiled("--target", "all"), compiled()
    root = next(id for id in locked.own if locked.name(id) == "cairn")
    whole = locked.reached(root, everywhere)

    def fill(row):
        names, line = row
        alone = len(whole) - len(locked.reached(root, everywhere, names))
        return line, re.sub(r"\|[^|]*\|$", f"| {alone} |", line)

    for line, filled in map(fill, rows(text)):
        text = text.replace(line, filled)
    total = (
        f"The program and its build have {len(everywhere)} crates from elsewhere for all targets, {len(here)} on Linux."
    )
    versions = {}
    for name, version in sorted(everywhere):
        versions.setdefault(name, []).append(version)
    doubles = [f"- `{name}` {', '.join(v)}" for name, v in versions.items() if len(v) > 1]
    for name, value in (("counts", total), ("doubles", "\n".join(doubles))):
        text = re.sub(MARK.format(name), lambda m, value=value: f"{m[1]}\n\n{value}\n\n{m[2]}", text, flags=re.S)
    return text, len(everywhere)


def fresh():
    """All versions as a build without the lock file takes them."""
    with tempfile.TemporaryDirectory() as folder:
        for name in run("git", "ls-files", "--cached", "--others", "--exclude-standard").splitlines():
            if name.endswith((".rs", "Cargo.toml")) and (ROOT / name).is_file():
                (Path(folder) / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(ROOT / name, Path(folder) / name)
        return Resolution(folder)


def main():
    locked = Resolution(ROOT, "--locked")
    faults = []
    text, count = counted(PAGE.read_text(), locked)
    if "--write" in sys.argv[1:]:
        PAGE.write_text(text)
    elif text != PAGE.read_text():
        faults.append(f"{PAGE.relative_to(ROOT)} has other counts: tests/dependencies.py --write")
    if count > MOST:
        faults.append(f"{count} crates are more than {MOST}")
    reasoned = [name for names, _ in rows(text) for name in names]
    named = {locked.name(id) for id in locked.direct()}
    faults += [f"{PAGE.name} has no reason for {name}" for name in sorted(named - set(reasoned))]
    faults += [f"{PAGE.name} has {name}, which nothing here names" for name in sorted(set(reasoned) - named)]
    known = locked.meetings()
    for crate, used, version in sorted(fresh().meetings() - known):
        if not any(known[:2] == (crate, used) for known in known):
            faults.append(
                f"without the lock file, {crate} takes {used} {version} while ours is another one: a build may fail. "
                f"Use another crate than {crate}, or bound its version."
            )
    print("\n".join(faults) or f"{count} crates, each direct one with its reason; an unlocked build fits together")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())

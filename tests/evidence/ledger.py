"""The ledger: claims, what was measured of them, and the pages that state them."""

import argparse
import datetime
import functools
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import pages
import tables

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
CLAIMS = HERE / "claims.toml"
MEASURED = HERE / "measured.json"
PROGRAM = ROOT / "target" / "release" / ("cairn.exe" if os.name == "nt" else "cairn")
# Of every bake: whatever else changes cannot move a figure.
ROOMS = ["geometry", "statics", "input", "engine", "prepare", "analysis", "motion", "show", "core"]
CODE = ["Cargo.lock", "examples/assets", "proto", "server/codegen", *(f"server/{room}/src" for room in ROOMS)]


@dataclass(frozen=True)
class Run:
    """Bakes of one scene, one for each seed."""

    name: str
    scene: str
    set: tuple
    seeds: tuple

    @property
    def files(self):
        return [self.scene, *CODE]


@dataclass(frozen=True)
class Claim:
    """A figure that pages state."""

    name: str
    # What it is taken from: the reports of a run; of two, as a ratio; or a table that a study has written.
    run: str
    over: str
    table: dict
    figure: str
    # In which the median must be, and each seed.
    range: tuple
    each: tuple
    # How pages show it: digits, or a format of `median`, `low`, `high`.
    digits: int
    text: str
    quick: bool

    def show(self, value):
        return self.text.format(**{part: f"{value[part]:,.{self.digits}f}" for part in ("median", "low", "high")})


def read():
    """Runs, claims, and blocks of pages, by name."""
    content = tomllib.loads(CLAIMS.read_text())
    runs, claims = {}, {}
    for name, run in content["runs"].items():
        runs[name] = Run(name, run["scene"], tuple(run.get("set", ())), tuple(run.get("seeds", (1,))))
    for name, claim in content["claims"].items():
        unknown = set(claim) - {"run", "over", "table", "figure", "range", "each", "digits", "text", "quick", "why"}
        if unknown or not {"run", "table"} & set(claim):
            raise SystemExit(f"{CLAIMS}: claims.{name}: give `run` or `table`; unknown: {sorted(unknown)}")
        claims[name] = Claim(
            name,
            claim.get("run", ""),
            claim.get("over", ""),
            claim.get("table", {}),
            claim.get("figure", ""),
            tuple(claim.get("range", ())),
            tuple(claim.get("each", ())),
            claim.get("digits", 2),
            claim.get("text", "{median}"),
            claim.get("quick", False),
        )
    return runs, claims, content.get("blocks", {})


def stored():
    return json.loads(MEASURED.read_text()) if MEASURED.exists() else {}


@functools.cache
def code_of(run):
    """A hash of all that decides a run's figures."""
    listed = subprocess.run(["git", "ls-files", "-z", "--", *run.files], cwd=ROOT, capture_output=True, check=True)
    digest = hashlib.sha256(json.dumps([run.scene, run.set, run.seeds]).encode())
    for name in sorted(listed.stdout.decode().split("\0")):
        if name:
            digest.update(name.encode() + b"\0" + (ROOT / name).read_bytes())
    return digest.hexdigest()[:16]


def bake(run, seed):
    """The report of one bake: its figures, counts and CPU seconds, flat."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = [str(PROGRAM), "bake", str(ROOT / run.scene), "--seed", str(seed), "--threads", "1", "--no-cache"]
        for assignment in run.set:
            command += ["--set", assignment]
        command += ["-o", str(Path(folder) / "pile.json"), "--report", str(report)]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(f"{' '.join(command)}\n{done.stderr.strip()}")
        return figures_of(json.loads(report.read_text()))


def figures_of(report):
    """Numbers by name; seconds by stage as `seconds.hold`."""
    figures = {}

    def walk(value, name):
        if isinstance(value, bool):
            figures[name] = float(value)
        elif isinstance(value, (int, float)):
            figures[name] = value
        elif isinstance(value, dict):
            for key, inner in value.items():
                walk(inner, f"seconds.{key}" if name == "seconds" else key)

    walk(report, "")
    return figures


class MissingError(Exception):
    """A report lacks a figure: what never rests has no time of rest."""


def figure_of(figures, name):
    """A figure, or a sum of several: `seconds.release+seconds.hold`."""
    try:
        return sum(figures[part] for part in name.split("+"))
    except KeyError as missing:
        raise MissingError(
            f"the report of {figures['run']}, seed {figures['seed']}, has no {missing.args[0]}"
        ) from None


def measure(runs, jobs):
    """Reports of each run, by name: a list of figures, one for each seed."""
    begin = time.monotonic()
    tasks = [(run, seed) for run in runs for seed in run.seeds]
    with ThreadPoolExecutor(jobs) as pool:
        found = list(pool.map(lambda task: bake(*task), tasks))
    print(f"{len(tasks)} bakes in {time.monotonic() - begin:.0f} s", file=sys.stderr)
    reports = {run.name: [] for run in runs}
    for (run, seed), figures in zip(tasks, found):
        reports[run.name].append(figures | {"run": run.name, "seed": seed})
    return reports


def value_of(claim, reports):
    """Median, least and most over the seeds."""
    if claim.table:
        values = [tables.value(ROOT, claim.table)]
    else:
        values = [figure_of(figures, claim.figure) for figures in reports[claim.run]]
        if claim.over:
            values = [a / figure_of(b, claim.figure) for a, b in zip(values, reports[claim.over])]
    return {"median": median(values), "low": min(values), "high": max(values)}


def ledger_of(claims, blocks):
    known = stored()
    shown = {name: claim.show(known[name]) for name, claim in claims.items() if name in known}
    return pages.Ledger(shown, {name for name, claim in claims.items() if not claim.quick}, blocks)


def faults_of(claim, value):
    """Sentences on what leaves its range."""
    found = []
    if claim.range and not claim.range[0] <= value["median"] <= claim.range[1]:
        found.append(f"{claim.name}: {value['median']:.4g} is outside of {claim.range[0]} to {claim.range[1]}")
    if claim.each and not (claim.each[0] <= value["low"] and value["high"] <= claim.each[1]):
        spread = f"{value['low']:.4g} to {value['high']:.4g}"
        found.append(f"{claim.name}: {spread} over the seeds is outside of {claim.each[0]} to {claim.each[1]}")
    return found


def needed(claims):
    return {name for claim in claims for name in (claim.run, claim.over) if name}


def quick(runs, claims, jobs):
    """Measures the quick claims; what leaves its range fails."""
    chosen = [claim for claim in claims.values() if claim.quick]
    reports = measure([runs[name] for name in sorted(needed(chosen))], jobs)
    faults = []
    for claim in chosen:
        try:
            value = value_of(claim, reports)
        except MissingError as missing:
            faults.append(f"{claim.name}: {missing}")
            continue
        print(f"{claim.name:28} {value['median']:10.4f} ({value['low']:.4f} to {value['high']:.4f})")
        faults += faults_of(claim, value)
    for fault in faults:
        print(f"MOVED: {fault}")
    if faults:
        print("Correct what moved it, or change the range and say why in the claim's own `why`.")
    return 1 if faults else 0


def weekly(runs, claims, jobs, again):
    """Measures what the code has changed since, run by run: one that was ended goes on there."""
    known, reports, missing = stored(), {}, []
    today = datetime.date.today().isoformat()
    for name in sorted(needed(claims.values())):
        mine = [claim for claim in claims.values() if claim.run == name]
        codes = {claim.name: codes_of(claim, runs) for claim in mine}
        if not again and all(known.get(claim.name, {}).get("code") == codes[claim.name] for claim in mine):
            continue
        # What is compared by its time is measured side by side.
        group = {name, *(claim.over for claim in mine if claim.over)} - reports.keys()
        begin = time.monotonic()
        reports |= measure([runs[one] for one in sorted(group)], jobs)
        seconds = round(time.monotonic() - begin)
        for claim in mine:
            try:
                value = value_of(claim, reports)
            except MissingError as fault:
                missing.append(f"{claim.name}: {fault}")
                continue
            known[claim.name] = value | {"code": codes[claim.name], "on": today, "seconds": seconds}
        write(known, claims)
    for claim in claims.values():
        if claim.table:
            known[claim.name] = value_of(claim, {}) | {"code": [], "on": tables.day(ROOT, claim.table), "seconds": 0}
    write(known, claims)
    # By itself it says what it took.
    subprocess.run([ROOT / "tests" / "run", "first"], check=True)
    # Every commit is only tried in part in two of the Blenders.
    subprocess.run([ROOT / "tests" / "addon" / "run"], check=True)
    code = show(runs, claims)
    for fault in missing:
        print(f"NOT MEASURED: {fault}")
    return 1 if missing else code


def codes_of(claim, runs):
    """Of all runs that a claim needs."""
    return [code_of(runs[name]) for name in (claim.run, claim.over) if name]


def write(known, claims):
    kept = {name: known[name] for name in sorted(known) if name in claims}
    MEASURED.write_text(json.dumps(kept, indent=1) + "\n")


def show(runs, claims):
    """All claims, with what moved out of its range and what was measured of other code."""
    known, faults = stored(), []
    for claim in claims.values():
        value = known.get(claim.name)
        if value is None:
            print(f"{claim.name:28} not measured yet")
            faults.append(claim.name)
            continue
        is_old = value["code"] != codes_of(claim, runs)
        moved = faults_of(claim, value)
        faults += moved
        state = "MOVED" if moved else "older code" if is_old else ""
        print(f"{claim.name:28} {claim.show(value):28} {value['on']} {state}".rstrip())
    return 1 if faults else 0


def main(arguments):
    parser = argparse.ArgumentParser(prog="tests/evidence/run", description=__doc__)
    parser.add_argument("what", choices=["quick", "weekly", "show", "pages", "check"])
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="bakes at once")
    parser.add_argument("--again", action="store_true", help="weekly: also what has not changed")
    chosen = parser.parse_args(arguments)
    runs, claims, blocks = read()
    if chosen.what in ("quick", "weekly") and not PROGRAM.exists():
        raise SystemExit(f"{PROGRAM} is missing: cargo build --release --locked --bins")
    match chosen.what:
        case "quick":
            return quick(runs, claims, chosen.jobs)
        case "weekly":
            return weekly(runs, claims, chosen.jobs, chosen.again)
        case "show":
            return show(runs, claims)
        case "pages":
            return pages.write(ROOT, ledger_of(claims, blocks))
        case "check":
            return pages.check(ROOT, HERE / "plain.toml", ledger_of(claims, blocks))

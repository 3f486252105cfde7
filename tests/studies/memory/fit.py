#!/usr/bin/env python3
"""Fits the estimate of a bake's peak memory (`server/job/src/memory.rs`) to bakes, and writes the table in README.md.

    cargo build --release
    python tests/studies/memory/fit.py       some minutes; needs numpy

Rows of bakes that were measured are kept in `target/memory`: delete that folder to measure again.
"""

import json
import subprocess
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[3]
KEPT = ROOT / "target" / "memory"
PROGRAM = ROOT / "target" / "release" / "cairn"
PAGE = Path(__file__).with_name("README.md")
MARK = "<!-- rows -->\n"
MIB = 1 << 20
# How memory grows with the number of bodies: of the study of growth, from 100 to 100,000.
POWER = 0.9


def runs():
    """Scenes and arguments."""
    examples = [path.stem for path in sorted((ROOT / "examples").glob("*.toml"))]
    draft = ["--accuracy", "draft"]
    yield from ((name, draft) for name in examples)
    for count in (50, 200, 800):
        yield from ((name, [*draft, "--set", f"fill.count={count}"]) for name in ("sticks", "scrap"))
    yield from (("column", [*draft, "--frames", str(frames)]) for frames in (100, 400, 1500))
    yield from ((name, ["--accuracy", "standard"]) for name in ("sticks", "books", "crockery", "contacts"))
    for name in ("sticks",):
        yield from ((name, [*draft, "--set", one]) for one in ("glue=natural", "control=off"))


def measured(name, arguments):
    kept = KEPT / f"{name} {' '.join(arguments).replace('/', '_')}.json"
    if kept.exists():
        return json.loads(kept.read_text())
    scene = f"examples/{name}.toml"
    plan = subprocess.run([PROGRAM, "plan", scene, *arguments, "--json"], cwd=ROOT, capture_output=True, check=True)
    result, report = KEPT / "pile.glb", KEPT / "report.json"
    bake = ["bake", scene, *arguments, "--no-cache", "-q", "-o", result, "--report", report]
    subprocess.run([PROGRAM, *bake], cwd=ROOT, check=True)
    plan = json.loads(plan.stdout)
    row = {
        "scene": " ".join([name, *arguments[1:]]),
        "bodies": plan["plan"]["expected_bodies"],
        "result": plan["most_result_bytes"]["glb"] / MIB,
        "peak": json.loads(report.read_text())["peak_memory_bytes"] / MIB,
    }
    kept.write_text(json.dumps(row))
    return row


def main():
    KEPT.mkdir(parents=True, exist_ok=True)
    rows = [measured(*run) for run in runs()]
    peak = np.array([row["peak"] for row in rows])
    columns = np.array([[1, row["bodies"] ** POWER, row["result"]] for row in rows])
    # Of relative errors.
    expected = peak
    for _ in range(50):
        weights, *_ = np.linalg.lstsq(columns / expected[:, None], peak / expected, rcond=None)
        expected = columns @ weights
    factors = np.exp(np.abs(np.log(peak / expected)))
    text = PAGE.read_text()
    text = text[: text.index(MARK) + len(MARK)]
    text += "\n| scene | peak, MiB | expected, MiB |\n| --- | --- | --- |\n"
    for row, mib in zip(rows, expected, strict=True):
        text += f"| {row['scene']} | {row['peak']:.0f} | {mib:.0f} |\n"
    base, bodies, result = weights
    text += f"\nMiB: {base:.1f}, and {bodies:.3f} for the bodies to the power of {POWER}, and {result:.2f} for each "
    text += f"MiB of the result at most. Nine of ten of these {len(rows)} bakes are within a factor of "
    text += f"{np.quantile(factors, 0.9):.2f} of that.\n"
    PAGE.write_text(text)
    print(text[text.index(MARK) :])


if __name__ == "__main__":
    main()

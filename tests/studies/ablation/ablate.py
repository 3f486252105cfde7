"""Which numeric constants of the physics matter? Halves and doubles each of them over twelve small scenes.

A constant counts as felt in a scene if one of the headline figures leaves the range that five seeds span there, widened
by half of its width on both sides. The scenes are baked in the order of their file; after the first one in which a
constant is felt, no further one is baked for it. Called again, it continues where it ended.

    python3 tests/studies/ablation/ablate.py            everything: some 40 minutes of two cores
    python3 tests/studies/ablation/ablate.py --only glue --jobs 1
    python3 tests/studies/ablation/ablate.py --so-far   the page, of what is done

How: a copy of the sources in target/ablation gets a function in place of each constant, which reads its factor from the
environment; that copy is built once. Constants that the compiler needs (lengths of arrays, patterns) stay, and are
listed.
"""

import argparse
import concurrent.futures
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import written

ROOT = Path(__file__).resolve().parents[3]
HOME = ROOT / "target" / "ablation"
TREE = HOME / "tree"
SCENES = Path(__file__).parent / "scenes.json"
PAGE = Path(__file__).parent / "ablation.md"
# The sources whose constants are changed.
SOURCES = [f"server/{room}/src" for room in ("statics", "engine", "prepare", "analysis", "motion", "show", "core")]
FACTORS = (0.5, 2.0)
SEEDS = range(1, 6)
# A bake that takes this many seconds instead of one hangs.
LIMIT = 120
FIGURES = [
    "bodies",
    "fill_fraction",
    "shape_iou_start",
    "kept_shape",
    "protrusion_rel",
    "penetration_mean_rel",
    "penetration_p95_rel",
    "drift_p95_rel",
    "rest_seconds",
    "unsupported_fraction",
    "hanging",
    "glue_dots",
    "steps",
]
NUMBERS = r"f64|f32|usize|u32|u64|i32|\[f64; ?\d+\]|\[f32; ?\d+\]|\(f64, f64\)|\(f64, f64, f64\)"
CONSTANT = re.compile(rf"^((?:pub(?:\([a-z]+\))? )?)const ([A-Z][A-Z0-9_]*): ({NUMBERS}) = ([^;]*);", re.M)
# Comments and strings, in which no name counts.
TEXT = re.compile(r'//[^\n]*|"(?:\\.|[^"\\])*"')

SUPPORT = """//! A number of the sources, times the factor that the environment gives for it.
use std::io::Write;

pub trait Number: Copy {
    fn times(self, factor: f64) -> Self;
}
macro_rules! real {
    ($($t:ty)*) => { $(impl Number for $t { fn times(self, f: f64) -> $t { (self as f64 * f) as $t } })* }
}
macro_rules! whole { ($($t:ty)*) => { $(impl Number for $t {
    fn times(self, f: f64) -> $t {
        let to = (self as f64 * f).round() as $t;
        // One is no half, but it can be none or two.
        if to == self && f < 1.0 && self > 0 { self - 1 } else { to }
    }
})* } }
real! { f64 f32 }
whole! { usize u32 u64 i32 }
impl<T: Number, const N: usize> Number for [T; N] {
    fn times(self, f: f64) -> [T; N] { self.map(|x| x.times(f)) }
}
impl Number for (f64, f64) {
    fn times(self, f: f64) -> (f64, f64) { (self.0 * f, self.1 * f) }
}
impl Number for (f64, f64, f64) {
    fn times(self, f: f64) -> (f64, f64, f64) { (self.0 * f, self.1 * f, self.2 * f) }
}

pub fn value<T: Number>(name: &str, usual: T) -> T {
    if let Some(path) = std::env::var_os("ABLATION_SEEN") {
        if let Ok(mut file) = std::fs::OpenOptions::new().create(true).append(true).open(path) {
            let _ = file.write_all(format!("{name}\\n").as_bytes());
        }
    }
    match std::env::var("ABLATION").ok().as_deref().and_then(|given| given.split_once('=')) {
        Some((changed, factor)) if changed == name => usual.times(factor.parse().unwrap()),
        _ => usual,
    }
}
"""


def without_tests(text):
    """The part of a file before its tests."""
    return text.split("#[cfg(test)]")[0]


def constants():
    """Every numeric constant: name (file:NAME) -> (type, value), as the sources have them."""
    found = {}
    for folder in SOURCES:
        for path in sorted((ROOT / folder).rglob("*.rs")):
            name = path.relative_to(ROOT).as_posix()
            if "/tests" in name:
                continue
            for match in CONSTANT.finditer(without_tests(path.read_text())):
                found[f"{name}:{match[2]}"] = (match[3], " ".join(match[4].split()))
    return found


def in_code(text, change):
    """Applies a function to the code between comments and strings."""
    parts, at = [], 0
    for match in TEXT.finditer(text):
        parts += [change(text[at : match.start()]), match[0]]
        at = match.end()
    return "".join(parts) + change(text[at:])


def rewrite(path, name, kept, everywhere):
    """A file with functions for constants. `kept`: constants that stay; `everywhere`: names of any file's functions."""
    text = path.read_text()
    head, tests = without_tests(text), text[len(without_tests(text)) :]
    own = {m[2] for m in CONSTANT.finditer(head)}
    changed = {c for c in own if f"{name}:{c}" not in kept}
    named = {c for c in everywhere if re.search(rf"(?:use [^;]*|::)\b{c}\b", head)} - own
    calls = changed | named
    if not calls:
        return
    word = re.compile(r"\b(" + "|".join(sorted(calls)) + r")\b(?!\s*\()")

    def use_calls(code):
        lines = re.split(r"(\b(?:pub(?:\([a-z]+\))? )?use [^;]*;)", code)
        return "".join(part if i % 2 else word.sub(r"\1()", part) for i, part in enumerate(lines))

    marked = CONSTANT.sub(lambda m: f"\x01{m[1]}\x02{m[2]}\x02{m[3]}\x02{m[4]}\x03" if m[2] in changed else m[0], head)

    def define(match):
        visible, constant, kind, value = match[1].split("\x02")
        value = use_calls(value)
        return (
            f"#[allow(non_snake_case)] {visible}fn {constant}() -> {kind} {{ static V: std::sync::OnceLock<{kind}> = "
            f'std::sync::OnceLock::new(); *V.get_or_init(|| crate::ablation::value("{name}:{constant}", {value})) }}'
        )

    pieces = re.split(r"(\x01[^\x03]*\x03)", marked)
    made = [re.sub(r"\x01([^\x03]*)\x03", define, p) if p.startswith("\x01") else in_code(p, use_calls) for p in pieces]
    path.write_text("".join(made) + tests)


def copy_sources():
    shutil.rmtree(TREE, ignore_errors=True)
    files = subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True).splitlines()
    for file in files:
        if (ROOT / file).exists() and not file.startswith(("examples/pictures", "addon/")):
            (TREE / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / file, TREE / file)


def cargo(*arguments):
    environment = dict(os.environ, CARGO_TARGET_DIR=str(HOME / "target"))
    return subprocess.run(["cargo", *arguments], cwd=TREE, env=environment, capture_output=True, text=True)


def build():
    """The program whose constants can be changed; and the constants that cannot be."""
    known = constants()
    kept_file = HOME / "kept.json"
    kept = set(json.loads(kept_file.read_text())) if kept_file.exists() else set()
    for _ in range(30):
        copy_sources()
        for crate in SOURCES:
            if not (TREE / crate).exists():
                continue
            (TREE / crate / "ablation.rs").write_text(SUPPORT)
            root = TREE / crate / "lib.rs"
            root.write_text(root.read_text() + "\n#[doc(hidden)]\npub mod ablation;\n")
        everywhere = {name.split(":")[1] for name in known if name not in kept}
        everywhere -= {name.split(":")[1] for name in kept}
        for folder in SOURCES:
            for path in sorted((TREE / folder).rglob("*.rs")):
                name = path.relative_to(TREE).as_posix()
                if path.name != "ablation.rs" and "/tests" not in name:
                    rewrite(path, name, kept, everywhere)
        made = cargo("check", "--release", "--bin", "cairn", "--message-format", "short")
        if made.returncode == 0:
            made = cargo("build", "--release", "--bin", "cairn")
            if made.returncode != 0:
                raise SystemExit("the copy cannot be built:\n" + made.stderr[-4000:])
            break
        lines = [line for line in made.stderr.splitlines() if ": error" in line]
        more = set()
        for line in lines:
            file, row = line.split(":")[:2]
            source = (TREE / file).read_text().splitlines()[int(row) - 1]
            names = set(re.findall(r"\b([A-Z][A-Z0-9_]+)\b", source + line))
            more |= {name for name in known if name.split(":")[1] in names} - kept
        if not more:
            raise SystemExit("the copy cannot be built:\n" + made.stderr[-4000:])
        kept |= more
        kept_file.write_text(json.dumps(sorted(kept)))
    return known, kept


def bake(scene, seed, change=None, seen=None):
    """The headline figures of a scene; `None` for one that a bake does not have."""
    environment = dict(os.environ, ABLATION=change or "")
    if seen:
        environment["ABLATION_SEEN"] = str(seen)
    folder = HOME / "runs"
    folder.mkdir(parents=True, exist_ok=True)
    report = folder / f"{os.getpid()}-{scene['name']}-{seed}-{abs(hash(change))}.json"
    line = [
        HOME / "target/release/cairn",
        "bake",
        ROOT / scene["file"],
        "--seed",
        str(seed),
        "--no-cache",
        "--threads",
        "1",
    ]
    for setting in scene["set"]:
        line += ["--set", setting]
    line += ["--report", report, "-o", report.with_suffix(".csv")]
    try:
        ran = subprocess.run(list(map(str, line)), env=environment, capture_output=True, text=True, timeout=LIMIT)
    except subprocess.TimeoutExpired:
        return {"hangs": 1.0}
    if ran.returncode != 0:
        return {"fails": float(ran.returncode)}
    found = json.loads(report.read_text())
    for file in (report, report.with_suffix(".csv")):
        file.unlink(missing_ok=True)
    figures = {**found["counts"], **found["measures"], "bodies": found["bodies"]}
    return {name: figures.get(name) for name in FIGURES} | {"hash": found["result_blake3"]}


def ranges(base):
    """The range of each figure over the seeds, widened by half of its width on both sides."""
    spans = {}
    for name in FIGURES:
        values = [run[name] for run in base if isinstance(run.get(name), (int, float))]
        if values:
            slack = max((max(values) - min(values)) / 2, 1e-9)
            spans[name] = (min(values) - slack, max(values) + slack)
    return spans


def felt(run, spans):
    """The figures that left their range."""
    ends = [name for name in ("hangs", "fails") if name in run]
    out = [n for n, (low, high) in spans.items() if run.get(n) is not None and not low <= run[n] <= high]
    return ends + ([] if ends else out)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="bakes at once")
    parser.add_argument("--only", default="", help="constants whose file or name contains this")
    parser.add_argument("--so-far", action="store_true", help="bake nothing: write the page of the bakes that are done")
    chosen = parser.parse_args()
    HOME.mkdir(parents=True, exist_ok=True)
    known, kept = build() if not chosen.so_far else (constants(), set(json.loads((HOME / "kept.json").read_text())))
    kept &= set(known)
    scenes = json.loads(SCENES.read_text())
    log = HOME / "runs.jsonl"
    done = {}
    if log.exists():
        done = {(r["scene"], r["seed"], r["change"]): r["run"] for r in map(json.loads, log.read_text().splitlines())}

    def once(scene, seed, change=None):
        key = (scene["name"], seed, change)
        if key not in done and not (change and chosen.so_far):
            done[key] = bake(scene, seed, change)
            with log.open("a") as out:
                out.write(json.dumps({"scene": key[0], "seed": seed, "change": change, "run": done[key]}) + "\n")
        return done.get(key)

    def tried(name):
        """What a constant does in each scene that reads it, up to the first in which it is felt; `None`: not tried."""
        effect = {}
        for scene in (s for s in scenes if name in used[s["name"]]):
            usual = base[scene["name"]]
            for factor in FACTORS:
                run = once(scene, 1, f"{name}={factor}")
                if run is None:
                    return None
                same = run.get("hash") == usual[0].get("hash")
                effect[(factor, scene["name"])] = "same" if same else ", ".join(felt(run, ranges(usual)))
            if any(value not in ("same", "") for value in effect.values()):
                break
        return effect

    with concurrent.futures.ThreadPoolExecutor(chosen.jobs) as pool:
        for scene in scenes:
            seen = HOME / f"seen-{scene['name']}"
            if not seen.exists():
                seen.touch()
                bake(scene, 1, seen=seen)
        base = {s["name"]: list(pool.map(lambda seed, s=s: once(s, seed), SEEDS)) for s in scenes}
        used = {s["name"]: set((HOME / f"seen-{s['name']}").read_text().split()) for s in scenes}
        names = [name for name in known if name not in kept and chosen.only in name]
        effect = {name: found for name, found in zip(names, pool.map(tried, names)) if found is not None}
    page(known, kept, list(effect), effect)


def page(known, kept, names, effect):
    rows = {"felt": [], "within the seeds' spread": [], "same bytes": [], "not reached by these scenes": []}
    for name in names:
        values = effect[name].values()
        if not values:
            kind = "not reached by these scenes"
        elif all(value == "same" for value in values):
            kind = "same bytes"
        elif any(value not in ("same", "") for value in values):
            kind = "felt"
        else:
            kind = "within the seeds' spread"
        where = {
            f"{scene} x {factor:g}: {out}" for (factor, scene), out in effect[name].items() if out not in ("same", "")
        }
        rows[kind].append(f"| `{name}` | {known[name][1]} | {'; '.join(sorted(where))} |")
    text = [
        "# Which constants matter",
        "",
        "Each numeric constant of the physics was halved and doubled over twelve small scenes (`scenes.json`).",
        "A constant is *felt* if a headline figure leaves the range of five seeds, widened by half of its width",
        "on both sides. The first scene in which it is felt is given; no further one was tried.",
        "Constants that are never felt are candidates to be removed or merged.",
        "Made by `python3 tests/studies/ablation/ablate.py`.",
        "",
        f"{len(known)} constants: "
        + ", ".join(f"{len(r)} {kind}" for kind, r in rows.items())
        + f"; {len(kept)} stay, since the compiler needs them; "
        + f"{len(known) - len(names) - len(kept)} are not tried yet.",
    ]
    for kind, lines in rows.items():
        text += [
            "",
            f"## {kind[0].upper()}{kind[1:]}",
            "",
            "| constant | value | where |",
            "| --- | --- | --- |",
            *lines,
        ]
    text += ["", "## Not changed: the compiler needs them", "", ", ".join(f"`{name}`" for name in sorted(kept)), ""]
    written.write_measured(PAGE, "\n".join(text))


if __name__ == "__main__":
    main()

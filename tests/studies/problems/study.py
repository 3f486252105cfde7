"""Runs Cairn and other engines in turn on the problems, and writes results.json. Continues where it ended."""

import argparse
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

PEERS = Path(__file__).resolve().parents[1] / "peers"
sys.path.insert(0, str(PEERS))
# The two folders share engines, and how they are called.
from compare import is_there, kept, machine, run  # noqa: E402
from entries import DEBIAN, ENGINES, ROOT, Peer, compiled, options, python  # noqa: E402

HERE = Path(__file__).resolve().parent
PROBLEMS = ROOT / "target" / "release" / "examples" / "problems"
FOLDER = ROOT / "target" / "problems"
LIMIT = 20
"""CPU seconds after which an engine is stopped."""

STIFF = ("--cone", "elliptic", "--impratio", "10")
# Each at its defaults, and at more of its own dial. Frames come 60 times a second, and steps divide them.
ENTRIES = [
    Peer("rapier", "60 Hz, 4 iterations (defaults)", compiled("rapier"), options(60, 4), str(ENGINES)),
    Peer("rapier", "120 Hz, 4 iterations", compiled("rapier"), options(120, 4), str(ENGINES)),
    Peer("rapier", "240 Hz, 8 iterations", compiled("rapier"), options(240, 8), str(ENGINES)),
    Peer("rapier", "960 Hz, 8 iterations", compiled("rapier"), options(960, 8), str(ENGINES)),
    Peer("Box3D", "60 Hz, 4 substeps (defaults)", compiled("box3d"), options(60, 4), str(ENGINES)),
    Peer("Box3D", "120 Hz, 8 substeps", compiled("box3d"), options(120, 8), str(ENGINES)),
    Peer("Box3D", "240 Hz, 8 substeps", compiled("box3d"), options(240, 8), str(ENGINES)),
    Peer("Box3D", "960 Hz, 8 substeps", compiled("box3d"), options(960, 8), str(ENGINES)),
    Peer("Jolt", "60 Hz, 10 iterations (defaults)", compiled("jolt"), options(60, 10), str(ENGINES)),
    Peer("Jolt", "240 Hz, 10 iterations", compiled("jolt"), options(240, 10), str(ENGINES)),
    Peer("Jolt", "240 Hz, 50 iterations", compiled("jolt"), options(240, 50), str(ENGINES)),
    Peer("Jolt", "960 Hz, 20 iterations", compiled("jolt"), options(960, 20), str(ENGINES)),
    Peer("Bullet", "240 Hz, 10 iterations (Bullet's default)", python("in_bullet.py"), options(240, 10)),
    Peer("Bullet", "240 Hz, 50 iterations (pybullet's default)", python("in_bullet.py"), options(240, 50)),
    Peer("Bullet", "960 Hz, 50 iterations", python("in_bullet.py"), options(960, 50)),
    Peer("MuJoCo", "480 Hz, else as it comes", python("in_mujoco.py"), options(480, 100)),
    Peer("MuJoCo", "480 Hz, elliptic cones, impratio 10", python("in_mujoco.py"), options(480, 100, *STIFF)),
    Peer("MuJoCo", "1920 Hz, elliptic cones, impratio 10", python("in_mujoco.py"), options(1920, 100, *STIFF)),
    Peer("Blender", "240 Hz, 10 iterations (defaults)", DEBIAN, options(240, 10), "blender"),
    Peer("Blender", "480 Hz, 50 iterations", DEBIAN, options(480, 50), "blender"),
    Peer("Blender", "960 Hz, 50 iterations", DEBIAN, options(960, 50), "blender"),
]


class Ours:
    """A setting of Cairn."""

    name = "Cairn"

    def __init__(self, variant):
        self.settings, self.kind = variant["name"], variant["kind"]

    def command(self, problem, case, out):
        return [str(PROBLEMS), "bake", str(FOLDER), problem["name"], str(case), self.settings, "-o", str(out)]


class Theirs:
    """A setting of another engine."""

    kind = "peer"

    def __init__(self, peer):
        self.name, self.settings, self.peer = peer.name, peer.settings, peer

    def command(self, problem, case, out):
        peer, scene = self.peer, FOLDER / f"{problem['name']}-{case}.json"
        limit = () if self.name == "Blender" else ("--limit", str(LIMIT))
        return [*peer.command, str(scene), str(out), *peer.options, "--settings", peer.settings, *limit]


def can(entry, problem):
    """Blender takes no velocities, scenery of one part, and seconds to start: it runs few bodies. The control is about
    what stands."""
    if entry.kind == "control":
        return problem["stands"]
    if entry.name != "Blender":
        return True
    scene = json.loads((FOLDER / f"{problem['name']}-{problem['timed']}.json").read_text())
    moves = scene["launched"] or any(any(one["velocity"]) for one in scene["scenery"])
    parts = any(len(scene["shapes"][one["place"]["shape"]]["solid"].get("hulls", [])) > 1 for one in scene["scenery"])
    return not (problem["limit"] or moves or parts or len(scene["bodies"]) > 10)


def place(entry, problem):
    name = "".join(c if c.isalnum() else "-" for c in f"{entry.name}-{entry.settings}")
    return FOLDER / "runs" / problem["name"] / name


def figures(entry, problem, case, path):
    """CPU ms for each simulated second, and what the run was judged to be."""

    def make(part):
        out = path.with_suffix(".run")
        out.unlink(missing_ok=True)
        try:
            run(entry.command(problem, case, out))
            done = json.loads(out.read_text())
            judged = json.loads(run([str(PROBLEMS), "judge", str(FOLDER), problem["name"], str(case), str(out)]))
            cpu = 1e3 * done["cpu"] / done["seconds"]
        except RuntimeError as fault:
            print(fault, file=sys.stderr)
            cpu, judged = None, None
        out.unlink(missing_ok=True)
        part.write_text(json.dumps({"cpu": cpu, "judged": judged, "load": round(os.getloadavg()[0], 2)}))

    return kept(path, make)


def limit_of(entry, problem, folder):
    """By halves: the first case that stands, and its error."""
    falls, stands = -1, problem["cases"]
    while stands - falls > 1:
        middle = (falls + stands) // 2
        judged = figures(entry, problem, middle, folder / f"case{middle}.json")["judged"]
        if judged is None:
            return None
        falls, stands = (middle, stands) if judged else (falls, middle)
    found = [str(stands)] if stands < problem["cases"] else []
    return float(run([str(PROBLEMS), "limit", problem["name"], *found]))


def measure(problem, entries, rounds):
    """Every engine once, and that as often as there are rounds, so that a busy machine is busy for all."""
    able = [entry for entry in entries if can(entry, problem)]
    runs = {entry: [] for entry in able}
    for number in range(rounds):
        print(f"{problem['name']}, round {number + 1}", file=sys.stderr, flush=True)
        for entry in able:
            path = place(entry, problem) / f"round{number + 1}.json"
            runs[entry].append(figures(entry, problem, problem["timed"], path))
    rows = []
    for entry in able:
        cpu = [one["cpu"] for one in runs[entry]]
        if None in cpu:
            continue
        error = limit_of(entry, problem, place(entry, problem)) if problem["limit"] else runs[entry][0]["judged"]
        rows.append({"engine": entry.name, "settings": entry.settings, "kind": entry.kind, "cpu": cpu, "error": error})
    return {"problem": problem["name"], "rows": rows}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", nargs="*", metavar="NAME", help="only these; results.json stays as it is")
    parser.add_argument("--engines", nargs="*", metavar="NAME", help="only these; results.json stays as it is")
    parser.add_argument("--rounds", type=int, default=3, help="how often each setting runs")
    parser.add_argument("--fresh", action="store_true", help="forget what was measured")
    parser.add_argument("--again", nargs="*", default=[], metavar="NAME", help="forget what these engines did")
    chosen = parser.parse_args()
    if chosen.fresh:
        shutil.rmtree(FOLDER, ignore_errors=True)
    for name in chosen.again:
        for folder in FOLDER.glob(f"runs/*/{name}-*"):
            shutil.rmtree(folder)
    run([str(PROBLEMS), "write", str(FOLDER)])
    index = json.loads((FOLDER / "index.json").read_text())
    entries = [*map(Ours, index["variants"]), *(Theirs(peer) for peer in ENTRIES if is_there(peer))]
    entries = [one for one in entries if chosen.engines is None or one.name in chosen.engines]
    problems = [one for one in index["problems"] if chosen.problems is None or one["name"] in chosen.problems]
    measured = [measure(problem, entries, chosen.rounds) for problem in problems]
    found = machine()
    loads = [json.loads(path.read_text())["load"] for path in FOLDER.glob("runs/*/*/round*.json")]
    load = [min(loads), max(loads)]
    study = {"machine": found["model"], "cores": found["cores"], "load": load, "problems": measured}
    whole = chosen.problems is None and chosen.engines is None
    folder = HERE if whole else FOLDER
    (folder / "results.json").write_text(json.dumps(study, indent=1) + "\n")
    if whole:
        run([str(PROBLEMS), "page", str(HERE), "--pictures", str(FOLDER)])
    else:
        for one in measured:
            for row in one["rows"]:
                print(one["problem"], row["engine"], row["settings"], row["error"], row["cpu"], sep="\t")


if __name__ == "__main__":
    try:
        main()
    except subprocess.SubprocessError as fault:
        sys.exit(str(fault))

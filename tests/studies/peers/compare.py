"""Runs Cairn and its peers in turn on the same piles, and writes the table. Continues where it ended."""

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import table  # noqa: E402
import written  # noqa: E402
from entries import BASELINES, CAIRN, FEW, HERE, OURS, PEERS, PILES, ROOT, TARGET


def arguments():
    parser = argparse.ArgumentParser(description="Cairn and its peers on the same piles.")
    parser.add_argument("--piles", nargs="*", choices=[pile.name for pile in PILES], help="only these")
    parser.add_argument("--peers", nargs="*", metavar="NAME", help="only rows whose name begins so")
    parser.add_argument("--rounds", type=int, help="how often each row runs; 3, or 1 with --small")
    parser.add_argument("--frames", type=int, default=249, help="frames at 24 per second; with --small, 48")
    parser.add_argument("--set", action="append", default=[], help="a field of every scene, as for cairn bake")
    parser.add_argument("--limit", type=float, default=1200, help="CPU seconds after which an engine is stopped")
    parser.add_argument("--small", action="store_true", help="a few bodies, one round: whether it runs at all")
    parser.add_argument("--curves", action="store_true", help="also 609 sticks to finished F-curves, by the add-on")
    return parser.parse_args()


def machine():
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return {"model": models[0] if models else platform.processor(), "cores": os.cpu_count()}


def run(command, **variables):
    """On one core, with one thread."""
    pinned = ["taskset", "--cpu-list", str(max(os.sched_getaffinity(0)))] if shutil.which("taskset") else []
    environment = {**os.environ, "RAYON_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    environment |= variables
    done = subprocess.run(
        [*pinned, *command],
        cwd=ROOT,
        env=environment,
        text=True,
        capture_output=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.stdout


def pile_of(pile, chosen, folder):
    """The pile right after turning over; made again if other settings are asked for."""
    path = folder / "scene.json"
    wanted = [*pile.set(FEW if chosen.small else None), *chosen.set]
    known = json.loads(path.read_text()) if path.exists() else {}
    if known.get("set") != wanted or known.get("frames") != chosen.frames:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        sets = [part for assignment in wanted for part in ("--set", assignment)]
        run([str(CAIRN), "scene", pile.file, *sets, "--frames", str(chosen.frames), "-o", str(path)])
    return path


def kept(path, make):
    """What the file holds, if it is there; else what `make` writes there."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        make(part)
        part.rename(path)
    return json.loads(path.read_text())


def ours(scene, variant, path):
    return kept(path, lambda part: run([str(CAIRN), "bake", str(scene), "--variant", variant, "-o", str(part)]))


def theirs(scene, peer, limit, path):
    def make(part):
        end = ["--settings", peer.settings, *(() if "blender" in peer.name else ("--limit", str(limit)))]
        run([*peer.command, str(scene), str(part), *peer.options, *end])

    # With other settings, it is another run.
    if path.exists() and json.loads(path.read_text())["settings"] != peer.settings:
        path.unlink()
        path.with_suffix(".figures.json").unlink(missing_ok=True)
    return kept(path, make)


def measured(scene, run_path):
    path = run_path.with_suffix(".figures.json")
    return kept(path, lambda part: part.write_text(run([str(CAIRN), "measure", str(scene), str(run_path)])))


def is_there(peer):
    return not peer.program or Path(peer.program).exists() or shutil.which(peer.program) is not None


def main():
    chosen = arguments()
    if chosen.small and chosen.frames == 249:
        chosen.frames = 48
    rounds = chosen.rounds or (1 if chosen.small else 3)
    results = TARGET / ("small" if chosen.small else "full")
    piles = [pile for pile in PILES if chosen.piles is None or pile.name in chosen.piles]
    asked = [p for p in PEERS if chosen.peers is None or any(p.name.startswith(name) for name in chosen.peers)]
    peers = [p for p in asked if is_there(p) and (p.is_small or not chosen.small)]
    failed = {}
    for pile in piles:
        folder = results / pile.name
        scene = pile_of(pile, chosen, folder)
        for number in range(1, rounds + 1):
            where = folder / f"round{number}"
            for peer in peers:
                print(f"{pile.name}, round {number}: {peer.name}", file=sys.stderr, flush=True)
                try:
                    # Side by side, so that a busy machine is busy for all three.
                    for variant in OURS:
                        ours(scene, variant, where / peer.name / f"{variant}.json")
                    theirs(scene, peer, chosen.limit, where / peer.name / "peer.json")
                except RuntimeError as fault:
                    failed[(pile.name, peer.name)] = str(fault)
                    print(fault, file=sys.stderr)
            for variant in BASELINES:
                print(f"{pile.name}, round {number}: {variant}", file=sys.stderr, flush=True)
                ours(scene, OURS[0], where / variant / f"{OURS[0]}.json")
                ours(scene, OURS[1], where / variant / f"{OURS[1]}.json")
                ours(scene, variant, where / variant / "peer.json")
        for path in sorted((folder / "round1").glob("*/*.json")):
            # Cairn's own end is the same whoever it is paired with.
            if path.name == "peer.json":
                measured(scene, path)
        for variant in OURS:
            measured(scene, next((folder / "round1").glob(f"*/{variant}.json")))
    if chosen.curves:
        curves(results, rounds)
    file = results / "machine.json"
    file.write_text(json.dumps(machine() | {"load": os.getloadavg()}))
    text = table.page(results, [pile for pile in PILES if (results / pile.name).exists()])
    (results / "results.md").write_text(text)
    if not chosen.small:
        written.write_measured(ROOT / HERE / "results.md", text)
    print(text)
    return 1 if failed else 0


def curves(results, rounds):
    """The add-on's own benchmark: from a scene in Blender to finished F-curves, ours and Blender's."""
    script = ["tests/addon/benchmark.py", "--", "bake"]
    for number in range(1, rounds + 1):
        path = results / "curves" / f"round{number}.json"
        print(f"F-curves, round {number}", file=sys.stderr, flush=True)
        start = ["blender", "--background", "--factory-startup", "--python"]
        # A user's folders of its own, so that nothing is known of an earlier bake.
        with tempfile.TemporaryDirectory() as home:
            own = {name: home for name in ("HOME", "XDG_CONFIG_HOME", "XDG_CACHE_HOME", "XDG_DATA_HOME")}
            kept(path, lambda part: run([*start, *script, "--result", str(part)], **own))


if __name__ == "__main__":
    sys.exit(main())

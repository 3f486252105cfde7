#!/usr/bin/env python3
"""Layouts of household objects on trays, tables and shelves: what they take, and how many stand in MuJoCo.

    cargo build --release
    python tests/studies/clutter/measure.py 200 100 50        as many trays, tables and shelves; some minutes

Needs the packages mujoco and numpy, and a collection of other people's models (`CAIRN_COLLECTION`, or `../shared/data`
beside the workspace). Writes results.md. Layouts stay in `target/clutter`, and a run goes on where one ended: delete
that folder after a change.
"""

import json
import os
import statistics
import struct
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
# Of the package, this module needs nothing but Python.
sys.path[:0] = [str(ROOT / "python/cairn"), str(ROOT / "tests/studies")]

import clutter  # noqa: E402
import written  # noqa: E402

KEPT = ROOT / "target/clutter"
PROGRAM = Path(os.environ.get("CAIRN_PROGRAM", ROOT / "target/release/cairn"))
COLLECTION = Path(os.environ.get("CAIRN_COLLECTION", ROOT.parent / "shared/data")) / "object"
# Files of the collection, and by how much they are scaled: some are larger than life.
PROPS = [
    ("ycb/003_cracker_box_textured.gltf", 1),
    ("ycb/004_sugar_box_textured.gltf", 1),
    ("ycb/005_tomato_soup_can_textured.gltf", 1),
    ("ycb/006_mustard_bottle_textured.gltf", 1),
    ("ycb/009_gelatin_box_textured.gltf", 1),
    ("ycb/010_potted_meat_can_textured.gltf", 1),
    ("ycb_obj/YcbBanana.glb", 1),
    ("ycb_obj/YcbFoamBrick.glb", 1),
    ("tri/evo_bowl.gltf", 1),
    ("tri/plate_8in.gltf", 1),
    ("tri/yellow_bell_pepper_no_stem_low.gltf", 1),
    ("khronos/Avocado/glTF/Avocado.gltf", 0.08),
    ("khronos/WaterBottle/glTF/WaterBottle.gltf", 0.2),
    ("bullet/domino.glb", 1),
    ("bullet/lego.glb", 0.2),
    ("trimesh/rock.glb", 0.7),
    ("market/candy-bar.glb", 0.5),
    ("market/cup.glb", 0.4),
    ("market/egg.glb", 0.4),
]
# Boxes of a place, m: lower and upper corners.
TABLE = [((-1.2, 0.0, -0.6), (1.2, 0.04, 0.6))]
SHELF = [
    *(((-1.0, 0.38 * n, -0.22), (1.0, 0.38 * n + 0.02, 0.22)) for n in range(5)),
    *(((x, 0.0, -0.22), (x + 0.02, 1.92, 0.22)) for x in (-1.0, 0.98)),
    ((-1.0, 0.0, -0.24), (1.0, 1.92, -0.22)),
]
# Place, and the fewest and the most bodies.
KINDS = [("tray", (6, 20)), ("table", (50, 55)), ("shelf", (100, 110))]
# A body may move by this much, m.
ENOUGH = 0.002
PAGE = Path(__file__).with_name("results.md")
HEAD = """# Trays, tables and shelves of household objects

Written by `tests/studies/clutter/measure.py {counts}`: layouts of 19 household objects, most of them scans, on a tray
of 0.58 by 0.42 m, a table of 2.4 by 1.2 m and five boards of 2 by 0.44 m; bodies of 600 kg/m^3. CPU times are those of
two processes at a time, of a machine that other programs used, too. Drift is the largest way of a body in 2 s of MuJoCo
at its defaults, of layouts that our own proof alone had passed.

| place | made | bodies | taken away | CPU s | MB | drawn again | stand, % | median drift, mm | most, mm |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |
"""


def glb(boxes):
    """A model of boxes: the bytes of a .glb."""
    corners, triangles = [], []
    for low, high in boxes:
        first = len(corners)
        corners += [[(low, high)[n >> axis & 1][axis] for axis in range(3)] for n in range(8)]
        for quad in ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)):
            a, b, c, d = (first + n for n in quad)
            triangles += [a, b, c, a, c, d]
    points = struct.pack(f"<{3 * len(corners)}f", *(x for corner in corners for x in corner))
    indices = struct.pack(f"<{len(triangles)}H", *triangles)
    indices += b"\0" * (-len(indices) % 4)
    bounds = [[pick(corner[axis] for corner in corners) for axis in range(3)] for pick in (min, max)]
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(points) + len(indices)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(points)},
            {"buffer": 0, "byteOffset": len(points), "byteLength": len(indices)},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(corners), "type": "VEC3"}
            | {"min": bounds[0], "max": bounds[1]},
            {"bufferView": 1, "componentType": 5123, "count": len(triangles), "type": "SCALAR"},
        ],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(points) + len(indices), 0x004E4942) + points + indices
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def catalogue(kind, count):
    """Writes a catalogue and its place, and returns its path."""
    place = ROOT / "examples/assets/tray.glb"
    if kind != "tray":
        place = KEPT / f"{kind}.glb"
        place.write_bytes(glb({"table": TABLE, "shelf": SHELF}[kind]))
    text = f'count = [{count[0]}, {count[1]}]\nseed = 9\narrangement = ["scattered", "heaped", "stacked"]\n'
    if kind == "shelf":
        text = text.replace(', "heaped"', "")
    for path, scale in PROPS:
        text += f'[[props]]\npath = "{COLLECTION / path}"\nscale_min = {scale}\nscale_max = {scale}\ndensity = 600\n'
    text += f'[[places]]\npath = "{place}"\n'
    path = KEPT / f"{kind}.toml"
    path.write_text(text)
    return path


def make(kind, count, number):
    """Layouts, and the CPU time of one and the memory of a process as the data card has them."""
    folder = KEPT / kind
    command = [PROGRAM, "clutter", catalogue(kind, count), "-n", str(number), "-o", folder]
    done = subprocess.run([*command, "--sheet", "6", "--progress", "none"], capture_output=True, text=True)
    notes = [line for line in done.stderr.splitlines() if not line.startswith("note: ")]
    print(done.stdout + "\n".join(notes), flush=True)
    card = (folder / "README.md").read_text()
    said = [line for line in card.splitlines() if "CPU s in the mean" in line]
    kept = folder / "spent.txt"
    if "CPU s in the mean" in card:
        kept.write_text(said[0])
    words = kept.read_text().split()
    seconds, memory = float(words[words.index("CPU") - 1]), words[words.index("MB.") - 1]
    return list(clutter.read(folder, failed=True)), seconds, memory


def drifts_of(path, layouts):
    """The drift of each layout in MuJoCo, m; those that a file has are not measured again."""
    kept = json.loads(path.read_text()) if path.exists() else {}
    new = [layout for layout in layouts if str(layout.number) not in kept]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for layout, drift in zip(new, pool.map(clutter.mujoco_drift, new)):
            kept[str(layout.number)] = drift
    path.write_text(json.dumps(kept))
    return [kept[str(layout.number)] for layout in layouts]


def total(layouts, name):
    """Sums of counts by reason over layouts."""
    sums = {}
    for layout in layouts:
        for why, count in layout.line[name].items():
            sums[why] = sums.get(why, 0) + count
    return dict(sorted(sums.items()))


def main():
    KEPT.mkdir(parents=True, exist_ok=True)
    rows = []
    for (kind, count), number in zip(KINDS, map(int, sys.argv[1:])):
        if number == 0:
            continue
        layouts, seconds, memory = make(kind, count, number)
        made = [layout for layout in layouts if not layout.line["failed"]]
        again = total(layouts, "rejected")
        drifts = sorted(drifts_of(KEPT / kind / "drifts.json", made))
        stand = sum(drift < ENOUGH for drift in drifts)
        bodies = statistics.mean(len(layout.bodies) for layout in made)
        away = sum(sum(layout.line["taken_away"].values()) for layout in made) / max(len(made), 1)
        rows.append(
            f"| {kind} | {len(made)} of {number} | {bodies:.1f} | {away:.2f} | {seconds:.3f} | {memory} "
            f"| {sum(again.values())} | {100 * stand / len(made):.1f} | {1e3 * statistics.median(drifts):.2f} "
            f"| {1e3 * drifts[-1]:.2f} |"
        )
        print(rows[-1], again, total(made, "taken_away"), flush=True)
        counts = " ".join(sys.argv[1:])
        written.write_measured(PAGE, f"{HEAD.format(counts=counts)}{chr(10).join(rows)}\n")


if __name__ == "__main__":
    main()

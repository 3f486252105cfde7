"""three.py CHROMIUM NODE_MODULES FOLDER: three.js in a browser puts every body of FOLDER/pile.glb where the table has it."""

import pathlib
import sys

import browser
import table as tables

chromium, modules, work = sys.argv[1:]
table = tables.load(f"{work}/pile.json")


def files(path):
    top, _, rest = path.lstrip("/").partition("/")
    folder = {"modules": modules, "work": work}.get(top)
    return pathlib.Path(folder, rest) if folder else pathlib.Path(__file__).with_name("three.html")


frames = ",".join(map(str, tables.frames(table)))
answer = browser.ask(chromium, files, f"?fps={table['fps']}&frames={frames}", ["--disable-gpu"])

# Columns first, as three.js keeps matrices.
poses = {}
for frame, nodes in zip(tables.frames(table), answer["frames"]):
    for body, entry in enumerate(table["bodies"]):
        columns = nodes[entry["name"]]
        poses[frame, body] = [[columns[4 * c + r] for c in range(4)] for r in range(4)]
tables.compare(f"three.js {answer['revision']}", table, poses)

"""Takes bodies away from a pile, or tilts it, in another engine: a question a line, as JSON, and an answer a line.

elsewhere.py PILE.xml ENGINE TIMES: how far the body that moves most is from its place after `TIMES` characteristic
times, in diameters of the median prop.
"""

import json
import math
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import numpy as np
import pybullet

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "elsewhere"))
import replay

path, engine, times = sys.argv[1:]
pile = replay.read(path)
seconds = float(times) * pile.natural_time
set_gravity = pybullet.setGravity


def farthest(pile, poses):
    """In place of the share that stands."""
    ways = [np.linalg.norm(center - solid.center) for solid, (center, _) in zip(pile.solids, poses, strict=True)]
    return float(max(ways, default=0.0)) / pile.diameter


replay.standing = farthest


def way(without=None, tilt=0.0, azimuth=0.0):
    # Z is up in these files: the pile's Y is Z, and its Z is minus Y.
    x, z = math.sin(math.radians(azimuth)), math.cos(math.radians(azimuth))
    side, down = pile.gravity * math.sin(math.radians(tilt)), pile.gravity * math.cos(math.radians(tilt))
    gravity = [side * x, -side * z, -down]
    left = replace(pile, solids=[solid for number, solid in enumerate(pile.solids) if number != without])
    if engine == "Bullet":
        pybullet.setGravity = lambda *_: set_gravity(*gravity)
        return replay.in_bullet(left, seconds)
    tree = ElementTree.parse(path)
    root = tree.getroot()
    root.find("option").set("gravity", " ".join(map(str, gravity)))
    if without is not None:
        world = root.find("worldbody")
        world.remove(world.findall("body")[without])
    with tempfile.NamedTemporaryFile("w", suffix=".xml") as file:
        tree.write(file.name)
        return replay.in_mujoco(replace(left, path=file.name), seconds)


for line in sys.stdin:
    print(json.dumps(way(**json.loads(line))), flush=True)

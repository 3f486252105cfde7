"""What all engines in Python share: the pile, the command line, the clock and the result.

The files are those of examples/peers/format.rs: SI, Y up, quaternions x y z w."""

import argparse
import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np


AWAY = 1e30


@dataclass
class Scene:
    gravity: float
    friction: float
    """Of every pair. An engine that multiplies the two of a pair is given `friction ** 0.5`."""
    ground: float
    frames: int
    fps: float
    shapes: list
    bodies: list

    @property
    def seconds(self):
        return self.frames / self.fps


def read(path):
    content = json.loads(Path(path).read_text())
    return Scene(**{name: content[name] for name in Scene.__dataclass_fields__})


def arguments(description):
    """SCENE OUT, and the arguments of every engine. Blender's own arguments stand before `--`."""
    given = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("scene")
    parser.add_argument("out")
    parser.add_argument("--hz", type=float, default=240, help="steps per second")
    parser.add_argument("--iterations", type=int, help="solver iterations of a step")
    parser.add_argument("--settings", default="", help="how the table names the settings")
    parser.add_argument("--limit", type=float, default=float("inf"), help="CPU seconds after which it is stopped")
    return parser, given


def simulate(step, scene, hz, limit):
    """Steps to the scene's end, or as far as the limit lets it. CPU seconds of all threads, and simulated seconds."""
    steps, done = round(scene.seconds * hz), 0
    begin = time.process_time()
    while done < steps and time.process_time() - begin < limit:
        step()
        done += 1
    return time.process_time() - begin, done / hz


def write(scene, arguments, engine, cpu, seconds, positions, rotations, **more):
    """Shape `[body][3]`, `[body][4]`. What an engine no longer knows is far away."""
    known = [np.nan_to_num(np.asarray(values, float), nan=AWAY, posinf=AWAY) for values in (positions, rotations)]
    placed = zip(scene.bodies, *(values.tolist() for values in known))
    bodies = [{"shape": body["shape"], "position": at, "rotation": turned} for body, at, turned in placed]
    result = {"engine": engine, "settings": arguments.settings, "cpu": cpu, "seconds": seconds, "bodies": bodies}
    Path(arguments.out).write_text(json.dumps(result | more))

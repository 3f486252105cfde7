"""What all engines in Python share: the pile, the command line, the clock and the result.

The files are those of tests/studies/peers/format.rs: SI, Y up, quaternions x y z w."""

import argparse
import json
import sys
import time
from dataclasses import dataclass, field
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
    launched: list = field(default_factory=list)
    scenery: list = field(default_factory=list)
    exact: bool = False
    """No damping, and the poses of every frame are kept."""

    @property
    def seconds(self):
        return self.frames / self.fps


def read(path):
    content = json.loads(Path(path).read_text())
    return Scene(**{name: content[name] for name in Scene.__dataclass_fields__ if name in content})


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


def simulate(step, scene, hz, limit, poses):
    """Steps to the scene's end, or as far as the limit lets it. CPU seconds of all threads, simulated seconds, and the
    motion, where it is asked for. `poses` gives positions and rotations of all bodies; to read them does not count."""
    steps, per_frame = round(scene.seconds * hz), round(hz / scene.fps)
    assert not scene.exact or per_frame * scene.fps == hz, "frames need whole steps"
    motion = [frame_of(*poses())] if scene.exact else []
    cpu, done = 0.0, 0
    while done < steps and cpu < limit:
        begin = time.process_time()
        pause = done + per_frame if scene.exact else steps
        while done < pause and cpu + time.process_time() - begin < limit:
            step()
            done += 1
        cpu += time.process_time() - begin
        if scene.exact:
            motion.append(frame_of(*poses()))
    return cpu, done / hz, motion


def finite(values):
    return np.nan_to_num(np.asarray(values, float), nan=AWAY, posinf=AWAY, neginf=-AWAY)


def frame_of(positions, rotations):
    """Position and rotation of each body at one frame."""
    return np.hstack([finite(positions), finite(rotations)]).tolist()


def write(scene, arguments, engine, cpu, seconds, positions, rotations, **more):
    """Shape `[body][3]`, `[body][4]`. What an engine no longer knows is far away."""
    placed = zip(scene.bodies, finite(positions).tolist(), finite(rotations).tolist())
    bodies = [{"shape": body["shape"], "position": at, "rotation": turned} for body, at, turned in placed]
    result = {"engine": engine, "settings": arguments.settings, "cpu": cpu, "seconds": seconds, "bodies": bodies}
    Path(arguments.out).write_text(json.dumps(result | more))

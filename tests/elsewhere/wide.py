"""Eight piles in other engines, from the files alone: a study, by `tests/elsewhere/run --wide [MODEL...]`.

Prints, for each pile and engine, the share of the bodies that move by more than a quarter of the median prop's diameter
in five seconds. `.xml`: glued bodies are one body. UsdPhysics: they are joined by joints that break. Models that are
named take the place of the props of the last piles.
"""

import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
import replay
import stage

ROOT = pathlib.Path(__file__).parents[2]
CAIRN = ROOT / "target/release/cairn"
ASSETS = ROOT / "examples/assets"
SECONDS = 5
# Newton takes minutes for a second on a processor.
NEWTON_SECONDS = 1

BY_A_CART = ["--accuracy", "draft", "--static", str(ASSETS / "cart.glb"), "--set", "fill.count=60"]

# Control mesh, prop, its scale, further arguments.
PILES = {
    "sticks, T": ("letter-t.glb", "stick.glb", 2.6, []),
    "bananas, T": ("letter-t.glb", "banana.glb", 7, []),
    "balls, tower": ("tower.glb", "ball.glb", 0.45, []),
    "bricks, tower": ("tower.glb", "brick.glb", 2, []),
    "sticks, cone": ("cone-small.glb", "stick.glb", 1, ["--accuracy", "draft"]),
    "bananas by a cart": ("cone-small.glb", "banana.glb", 1, BY_A_CART),
    "cubes, spiral": ("spiral.glb", "cube.glb", 0.6, []),
    "books, stairs": ("stairs.glb", "book.glb", 2, []),
}


def bake(folder, control, prop, scale, more):
    command = [CAIRN, "bake", "--control", ASSETS / control, "--prop", ASSETS / prop, *more, "--quiet"]
    for end in ("min", "max"):
        command += ["--set", f"props.0.scale_{end}={scale}"]
    subprocess.run([*command, "-o", folder / "pile.xml"], check=True)
    physics = ["--set", "usd.physics=true", "--set", "usd.up_axis=z", "--set", "usd.motion=none"]
    subprocess.run([*command, *physics, "-o", folder / "pile.usda"], check=True)
    return replay.read(folder / "pile.xml")


def elsewhere(program, path, seconds, diameter):
    """The share that moves in a program of its own; None where that does not run."""
    command = [sys.executable, pathlib.Path(__file__).with_name(program), path, str(seconds)]
    done = subprocess.run(command, capture_output=True, text=True)
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    if not lines:
        print(done.stderr[-400:], file=sys.stderr)
        return None
    places = json.loads(lines[-1])
    ways = np.linalg.norm(np.array(places["after"]) - np.array(places["before"]), axis=1)
    return 1 - float(np.mean(ways <= replay.MOVED * diameter))


def main(models):
    names = list(PILES)
    for name, model in zip(reversed(names), models, strict=False):
        control, _, scale, more = PILES[name]
        PILES[name] = (control, pathlib.Path(model).resolve(), scale, more)
    engines = ["MuJoCo", "Bullet", "Bullet, USD", "joints", "broken", "PhysX, USD", f"Newton, USD, {NEWTON_SECONDS} s"]
    print(" | ".join(["pile", "bodies", *engines]), flush=True)
    for name, given in PILES.items():
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            pile = bake(folder, *given)
            glued, joints = stage.read(folder / "pile.usda", pile.diameter)
            share, broken = stage.in_bullet(glued, joints, SECONDS)
            moved = [
                1 - replay.in_mujoco(pile, SECONDS),
                1 - replay.in_bullet(pile, SECONDS),
                1 - share,
                len(joints),
                len(broken),
                elsewhere("physx.py", folder / "pile.usda", SECONDS, pile.diameter),
                elsewhere("newton_usd.py", folder / "pile.usda", NEWTON_SECONDS, pile.diameter),
            ]
            shown = ["-" if one is None else one if isinstance(one, int) else f"{one:.3f}" for one in moved]
            print(" | ".join(map(str, [name, len(glued.solids), *shown])), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])

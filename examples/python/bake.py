"""Bakes a pile on a server that runs as long as this script, and reads the result with numpy.

python examples/python/bake.py examples/sticks.toml pile.glb
"""

import sys

import cairn
import numpy as np

scene, output = sys.argv[1:]
with cairn.serve() as address:
    bake = cairn.Client(address).bake(scene, accuracy="draft", seed=7, fill={"count": 40})
    motion = bake.result()
    bake.save(output)

# [frame, body]: displacement of each body from frame 0, m.
moved = np.linalg.norm(motion.positions - motion.positions[0], axis=2)
print(f"{motion.positions.shape[1]} bodies, {len(motion.positions)} frames")
print(f"the farthest moves {moved.max() * 1000:.0f} mm; the pile is {motion.positions[-1, :, 1].max():.2f} m high")

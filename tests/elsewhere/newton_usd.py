"""newton_usd.py STAGE SECONDS: a stage in Newton, by its solver XPBD on the processor; prints what `physx.py` prints.

Its joints are no articulation, so that Newton must not ask for one; and they go in circles, for which its solver is too
eager by default.
"""

import json
import sys

import newton
import warp

FRAME, PARTS = 1 / 60, 10
RELAXATION = {"joint_linear_relaxation": 0.4, "joint_angular_relaxation": 0.2}

warp.config.quiet = True
path, seconds = sys.argv[1], float(sys.argv[2])
builder = newton.ModelBuilder()
builder.add_usd(path)
model = builder.finalize(device="cpu", skip_validation_joints=True)
solver = newton.solvers.SolverXPBD(model, iterations=10, **RELAXATION)
now, then, control, contacts = model.state(), model.state(), model.control(), model.contacts()
before = now.body_q.numpy()[:, :3].tolist()
for _ in range(round(seconds / FRAME) * PARTS):
    model.collide(now, contacts)
    now.clear_forces()
    solver.step(now, then, control, contacts, FRAME / PARTS)
    now, then = then, now
print(json.dumps({"before": before, "after": now.body_q.numpy()[:, :3].tolist()}), flush=True)

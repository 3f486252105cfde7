"""physx.py STAGE SECONDS: a stage in PhysX, as the package `ovphysx` has it.

Prints the places of the bodies' prims before and after, as JSON. A process of its own, since PhysX ends with it.
"""

import json
import os
import sys

import numpy as np
import ovphysx
import ovstage
from ovphysx.samples.python_samples.schema_support import physx_schema_paths
from ovphysx.types import ObjectScope, SimObjectType

STEP = 1 / 240


def places(physx):
    with physx.read_sync(SimObjectType.RIGID_BODY, ["position"], scope=ObjectScope.ALL) as result:
        return np.concatenate([np.array(group.tensors[0].numpy()) for group in result.groups if group.tensors])


path, seconds = sys.argv[1], float(sys.argv[2])
ovstage.population.register_usd_schemas([str(folder) for folder in physx_schema_paths()])
stage, physx = ovstage.Stage("pile"), ovphysx.PhysX()
ovstage.population.open_usd(stage, path, ordinal=1, domains=ovstage.PopulationDomain.ALL)
stage.advance_write_floor(ordinal=1).wait()
physx.wait_task(physx.attach_ovstage(stage, read_ordinal=1))
before = places(physx)
for _ in range(round(seconds / STEP)):
    physx.step_sync(STEP)
print(json.dumps({"before": before.tolist(), "after": places(physx).tolist()}), flush=True)
os._exit(0)

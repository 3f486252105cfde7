"""Bakes four seeds at once by asyncio, and keeps the one that keeps its shape best.

python examples/python/seeds.py examples/sticks.toml best.glb
"""

import asyncio
import sys

import cairn


async def one(client, scene, seed):
    bake = client.bake(scene, accuracy="draft", seed=seed, fill={"count": 40})
    await bake.result()
    print(f"seed {seed}: {bake.summary.body_count} bodies, IoU {bake.summary.measures['volume_iou']:.3f}", flush=True)
    return bake


async def main(scene, output):
    with cairn.serve(workers=2) as address:
        client = cairn.AsyncClient(address)
        bakes = await asyncio.gather(*(one(client, scene, seed) for seed in range(4)))
        await max(bakes, key=lambda bake: bake.summary.measures["volume_iou"]).save(output)


asyncio.run(main(*sys.argv[1:]))

"""What type checkers make of the package; never run."""

import cairn


def sync(client: cairn.Client) -> float:
    bake = client.bake("pile.toml", seed=7)
    for event in bake:
        if isinstance(event, cairn.Snapshot):
            print(event.positions.shape)
    assert client.analyse(bake_id=bake.id, friction=0.5).pile.stands
    assert bake.summary is not None
    return bake.summary.measures["volume_iou"]


async def later(client: cairn.AsyncClient) -> int:
    plan = await client.plan(cairn.read("pile.toml", control="off"))
    bake: cairn.AsyncBake = client.bake({"control_mesh": "dome.glb", "props": ["stick.glb"]})
    motion: cairn.Motion = await bake.result()
    await bake.cancel()
    return plan.plan.expected_body_count + len(motion.positions)

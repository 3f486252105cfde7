"""A pile in Houdini's LOPs: run it in Houdini's Python shell, or with hython. Not tested: no licence was at hand.

    hython examples/dcc/houdini.py pile.usdc [shot.hip [cairn_pile.hda]]

It references the stage under /pile. The pile is one PointInstancer: LOPs and Karma show it as it is; `unpack` it by the
node Split Point Instancers to move single bodies. With a third argument, the node becomes an asset with one parameter,
the file.
"""

import sys

import hou

stage, *outputs = sys.argv[1:]
lops = hou.node("/stage")
pile = lops.createNode("reference::2.0", "pile")
pile.parm("filepath1").set(stage)
pile.parm("primpath1").set("/pile")
pile.setDisplayFlag(True)

# The stage states its frames; Houdini takes them over.
layer = pile.stage()
hou.setFps(layer.GetTimeCodesPerSecond())
hou.playbar.setFrameRange(layer.GetStartTimeCode(), layer.GetEndTimeCode())

if len(outputs) > 1:
    subnet = lops.collapseIntoSubnet([pile], "cairn_pile")
    asset = subnet.createDigitalAsset("cairn_pile", outputs[1], "Cairn Pile", min_num_inputs=0, max_num_inputs=1)
    group = asset.type().definition().parmTemplateGroup()
    group.append(hou.StringParmTemplate("file", "Result", 1, string_type=hou.stringParmType.FileReference))
    asset.type().definition().setParmTemplateGroup(group)
    asset.node("pile").parm("filepath1").setExpression('chs("../file")')
    asset.type().definition().updateFromNode(asset)
if outputs:
    hou.hipFile.save(outputs[0])

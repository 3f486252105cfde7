"""A pile in Maya: run it in the script editor, or with mayapy. Not tested: no licence was at hand.

    mayapy examples/dcc/maya.py pile.usdc [pile.ma]

`reference` shows the stage itself (a proxy shape), which is quickest. `instance` makes Maya's own instances, one
transform for each body, keyed in each frame, which every renderer and script of Maya knows.
"""

import sys

import maya.standalone
from pxr import Usd, UsdGeom


def reference(path):
    """The stage as it is, played by Maya's time."""
    from maya import cmds

    cmds.loadPlugin("mayaUsdPlugin")
    transform = cmds.createNode("transform", name="pile")
    shape = cmds.createNode("mayaUsdProxyShape", name="pileShape", parent=transform)
    cmds.setAttr(f"{shape}.filePath", path, type="string")
    cmds.connectAttr("time1.outTime", f"{shape}.time")
    return transform


def instance(path):
    """Instances of the props, posed by the arrays of the PointInstancer."""
    from maya import cmds

    cmds.loadPlugin("mayaUsdPlugin")
    stage = Usd.Stage.Open(path)
    bodies = UsdGeom.PointInstancer(stage.GetDefaultPrim().GetChild("Bodies"))
    first, last = int(stage.GetStartTimeCode()), int(stage.GetEndTimeCode())
    props = []
    for target in bodies.GetPrototypesRel().GetTargets():
        before = set(cmds.ls(assemblies=True))
        cmds.mayaUSDImport(file=path, primPath=str(target))
        props.append(cmds.group(*(set(cmds.ls(assemblies=True)) - before), name=target.name))
    top = cmds.group(empty=True, name="pile")
    kinds = bodies.GetProtoIndicesAttr().Get()
    nodes = [cmds.instance(props[kind], name=f"body_{number}")[0] for number, kind in enumerate(kinds)]
    for frame in range(first, last + 1):
        matrices = bodies.ComputeInstanceTransformsAtTime(frame, frame, UsdGeom.PointInstancer.ExcludeProtoXform)
        for node, matrix in zip(nodes, matrices):
            cmds.xform(node, matrix=[value for row in matrix for value in row])
            cmds.setKeyframe(node, attribute=["translate", "rotate", "scale"], time=frame)
    cmds.filterCurve(cmds.ls(type="animCurveTA"))
    cmds.parent(nodes, top)
    cmds.hide(props)
    cmds.playbackOptions(minTime=first, maxTime=last)
    return top


if __name__ == "__main__":
    maya.standalone.initialize()
    from maya import cmds

    instance(sys.argv[1])
    if len(sys.argv) > 2:
        cmds.file(rename=sys.argv[2])
        cmds.file(save=True, type="mayaAscii")

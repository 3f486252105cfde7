"""Node groups: what differs between Blender's versions."""


def interface(group):
    """Gives a group a geometry in and out, and returns both sockets."""
    if hasattr(group, "interface"):
        for way in ("INPUT", "OUTPUT"):
            group.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    else:
        group.inputs.new("NodeSocketGeometry", "Geometry")
        group.outputs.new("NodeSocketGeometry", "Geometry")
    incoming, outgoing = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    return incoming.outputs[0], outgoing.inputs[0]

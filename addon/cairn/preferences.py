"""The server's place, and how to reach it."""

import re
from pathlib import Path
from types import SimpleNamespace

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from . import client
from .client import Fault, Target
from .job import Server
from .server import LocalServer, find

# Where an artist chooses the server.
client.place = " in the add-on's preferences"

_local = None


class CairnPreferences(bpy.types.AddonPreferences):
    bl_idname = __package__

    server: EnumProperty(
        name="Server",
        description="Computer that runs the server",
        items=[
            (
                "LOCAL",
                "This Computer",
                "A server on this computer, which starts when a bake needs it and ends with Blender",
            ),
            ("REMOTE", "Another Computer", "A Cairn server on another computer"),
        ],
    )
    program: StringProperty(
        name="Program",
        description="Path of the program `cairn`. If empty, the add-on's own program, or the one on the system's path",
        subtype="FILE_PATH",
    )
    address: StringProperty(
        name="Address", description="Address of the server, as HOST:PORT; https://HOST:PORT for an encrypted connection"
    )
    token: StringProperty(
        name="Token",
        description="Token that the server requires. Ask the operator of the server for it",
        subtype="PASSWORD",
    )
    certificates: StringProperty(
        name="Certificates",
        description="PEM file of the authority that signed the server's certificate. If empty, the authorities that "
        "this computer trusts",
        subtype="FILE_PATH",
    )

    estimates: BoolProperty(
        name="Expected Times",
        description="Show the expected time of each accuracy. The server on this computer estimates it after each "
        "change of the scene, while the tab is visible; it starts for that. If off, only Check asks",
        default=True,
    )

    def draw(self, _):
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "server", expand=True)
        if self.server == "LOCAL":
            layout.prop(self, "program")
            layout.prop(self, "estimates")
            problem = program_problem(self)
            if problem:
                for line in problem.split(". "):
                    layout.label(text=line, icon="ERROR")
        else:
            layout.prop(self, "address")
            layout.prop(self, "token")
            layout.prop(self, "certificates")
        layout.operator("cairn.test_server")


# Defaults, if a script has enabled the add-on for itself alone.
DEFAULTS = SimpleNamespace(server="LOCAL", program="", address="", token="", certificates="", estimates=True)


def of(context):
    entry = context.preferences.addons.get(__package__)
    return entry.preferences if entry else DEFAULTS


def program_problem(preferences):
    """Why there is no server on this computer; empty if there is one."""
    try:
        find(bpy.path.abspath(preferences.program))
    except Fault as fault:
        return fault.message
    return ""


def server(context):
    """The server that bakes go to."""
    preferences = of(context)
    if preferences.server == "LOCAL":
        return Server(local=local(), program=find(bpy.path.abspath(preferences.program)))
    address = preferences.address.strip()
    if not address:
        raise Fault("The server's address is missing. Set it in the add-on's preferences, or let this computer bake.")
    if not getattr(bpy.app, "online_access", True) and not _is_here(address):
        raise Fault("Blender may not go online. Allow it in Preferences, System, Network, or let this computer bake.")
    certificates = bpy.path.abspath(preferences.certificates)
    return Server(target=Target(address, preferences.token.strip(), certificates))


def _is_here(address):
    host = re.sub(r":\d*$", "", address.split("://")[-1]).strip("[]")
    return address.startswith("unix:") or host in ("localhost", "127.0.0.1", "::1")


def folder():
    """The folder in which the add-on may write."""
    if hasattr(bpy.utils, "extension_path_user") and __package__.startswith("bl_ext."):
        return Path(bpy.utils.extension_path_user(__package__, create=True))
    return Path(bpy.utils.user_resource("DATAFILES", path="cairn", create=True))


def local():
    global _local
    if _local is None:
        _local = LocalServer(folder())
    return _local


def stop_server():
    if _local is not None:
        _local.stop()

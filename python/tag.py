"""The wheel's tag: it has a program, so that it is for one platform, and for every Python 3."""

import os

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class Tag(BuildHookInterface):
    def initialize(self, version, build_data):
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{os.environ['CAIRN_PLATFORM']}"

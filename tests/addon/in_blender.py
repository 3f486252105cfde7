"""Runs pytest in Blender: `blender --background --python in_blender.py -- ARGUMENTS`, or with a Python that has bpy.

The folders of $CAIRN_TEST_PATH hold pytest.
"""

import os
import sys

sys.path[:0] = os.environ["CAIRN_TEST_PATH"].split(os.pathsep)
sys.dont_write_bytecode = True

import bpy
import pytest

print(f"Blender {bpy.app.version_string}, Python {sys.version.split()[0]}", flush=True)
arguments = sys.argv[sys.argv.index("--") + 1 :]
code = pytest.main(["-p", "no:cacheprovider", *arguments])
sys.stdout.flush()
sys.stderr.flush()
# Blender itself would end with 0.
os._exit(code)

#!/usr/bin/env python3
"""Makes the add-on for this machine, with the server inside, and puts it into the user's Blender.

    python3 addon/install.py                        into the Blender on the path, or where its installer puts it
    python3 addon/install.py --blender PROGRAM      into this one; again with another one for a second version
    python3 addon/install.py --zip FILE             installs a finished zip

Needs Rust and a Python from 3.11 on. Blender should be closed: it reads its add-ons when it starts.
"""

import argparse
import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "python"))

from executable import environment  # noqa: E402

PROGRAM = ROOT / "target" / "release" / ("cairn.exe" if os.name == "nt" else "cairn")
# A Python with pip, for what the zip contains besides.
TOOLS = ROOT / "target" / "addon" / "python"
# Where Blender's own installers put it.
USUAL = {
    "win32": ("C:/Program Files/Blender Foundation", "*/blender.exe"),
    "darwin": ("/Applications", "Blender*.app/Contents/MacOS/Blender"),
    "linux": ("/opt", "blender*/blender"),
}
# Runs in Blender.
INSTALL = """
import bpy
import addon_utils
zip = {zip!r}
if bpy.app.version >= (4, 2):
    bpy.ops.extensions.package_install_files(filepath=zip, repo="user_default", enable_on_install=True, overwrite=True)
else:
    bpy.ops.preferences.addon_install(filepath=zip, overwrite=True)
    bpy.ops.preferences.addon_enable(module="cairn")
bpy.ops.wm.save_userpref()
module = next((name for name in bpy.context.preferences.addons.keys() if name.split(".")[-1] == "cairn"), None)
print("cairn-installed", addon_utils.check(module)[1] if module else False, bpy.app.version_string)
"""


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--blender", metavar="PROGRAM", help="the Blender to install it into")
    parser.add_argument("--zip", type=Path, metavar="FILE", help="a zip of the add-on")
    args = parser.parse_args()
    blender = found(args.blender)
    install(blender, args.zip.resolve() if args.zip else built())


def found(asked):
    """The Blender to install into; of several versions, the newest."""
    if asked:
        return shutil.which(asked) or sys.exit(f"{asked} is no program: name Blender's own by --blender.")
    folder, pattern = USUAL.get(sys.platform, USUAL["linux"])
    usual = sorted(Path(folder).glob(pattern))
    program = shutil.which("blender") or (usual and str(usual[-1]))
    return program or sys.exit(f"There is no Blender on the path or in {folder}: name it by --blender PROGRAM.")


def built():
    """The zip for this machine."""
    subprocess.run(["cargo", "build", "--release", "--locked", "--bin", "cairn"], cwd=ROOT, check=True)
    command = [python_with_pip(), ROOT / "addon" / "build.py", "--server", PROGRAM]
    return Path(subprocess.run(command, check=True, text=True, stdout=subprocess.PIPE).stdout.splitlines()[-1])


def python_with_pip():
    if importlib.util.find_spec("pip"):
        return sys.executable
    return environment(TOOLS)


def install(blender, zip):
    code = INSTALL.format(zip=str(zip))
    # A Blender of the system's takes its libraries from the first Python on the path, which must be the system's, too.
    own = None if sys.prefix == "/usr" else str(Path(sys.executable).parent)
    path = [folder for folder in os.environ["PATH"].split(os.pathsep) if folder != own]
    variables = {**os.environ, "PATH": os.pathsep.join(path)}
    command = [blender, "--background", "--python-expr", code]
    done = subprocess.run(command, text=True, capture_output=True, env=variables)
    said = next((line for line in done.stdout.splitlines() if line.startswith("cairn-installed")), "")
    if "No module named 'numpy'" in done.stdout + done.stderr:
        sys.exit("This Blender has no numpy, which its own builds have: on Debian, `apt install python3-numpy`.")
    if not said.startswith("cairn-installed True"):
        sys.exit(f"Blender did not take {zip}:\n{done.stdout}\n{done.stderr}")
    print(f"{zip.name} is in Blender {said.split()[-1]}: start it, press N in the 3D View, and choose the tab Pile.")


if __name__ == "__main__":
    main()

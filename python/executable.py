"""Which platform a program is for, as its own first bytes say; the builds of the wheel and of the add-on ask. And a
Python of their own."""

import os
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple


class Kind(NamedTuple):
    # "linux", "windows" or "macos"; "x64" or "arm64".
    system: str
    machine: str

    @property
    def program(self):
        """The program's name on this platform."""
        return "cairn.exe" if self.system == "windows" else "cairn"


# By the number of the machine in the headers of ELF, PE and Mach-O.
ELF = {0x3E: "x64", 0xB7: "arm64"}
PE = {0x8664: "x64", 0xAA64: "arm64"}
MACH_O = {0x01000007: "x64", 0x0100000C: "arm64"}


def environment(home: Path) -> Path:
    """The Python of an environment of its own, which is made if it is not there."""
    python = home / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    if not python.exists() and subprocess.run([sys.executable, "-m", "venv", "--clear", home]).returncode:
        sys.exit("This Python cannot make environments: on Debian, `apt install python3-venv`.")
    return python


def kind_of(path: Path) -> Kind:
    head = path.read_bytes()[:4096]
    machine = system = None
    if head.startswith(b"\x7fELF"):
        system, machine = "linux", ELF.get(struct.unpack_from("<H", head, 18)[0])
    elif head.startswith(b"MZ"):
        (place,) = struct.unpack_from("<I", head, 60)
        if head[place : place + 4] == b"PE\0\0":
            system, machine = "windows", PE.get(struct.unpack_from("<H", head, place + 4)[0])
    elif head.startswith(b"\xcf\xfa\xed\xfe"):
        system, machine = "macos", MACH_O.get(struct.unpack_from("<I", head, 4)[0])
    if not machine:
        sys.exit(f"{path} is no program for Linux, Windows or macOS on x86-64 or ARM64: give the file `cairn` itself.")
    return Kind(system, machine)


def include(program: Path, place: Path) -> None:
    """Copies a program into a package: without its debug lines, which are most of what Cargo builds."""
    place.parent.mkdir(exist_ok=True)
    shutil.copyfile(program, place)
    place.chmod(0o755)
    if b".debug_line\0" in program.read_bytes() and shutil.which("strip"):
        subprocess.run(["strip", place], check=True)

#!/usr/bin/env python3
"""Builds the add-on: one zip that Blender 3.4 to 5.x installs.

    addon/build.py                                 for every platform; the server is found on the artist's machine
    addon/build.py --server target/release/cairn   with a server inside, for the server's platform

Needs Python 3.11 with pip, and PyPI for what `vendor.txt` pins. The unpacked add-on stays in `target/addon/cairn`.
"""

import argparse
import ast
import json
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

ADDON = Path(__file__).resolve().parent
ROOT = ADDON.parent
sys.path.insert(0, str(ROOT / "python"))

from executable import include, kind_of  # noqa: E402

BUF = "buf-bin==1.75.0"
PIP = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
# Parts of the libraries that no client needs.
LEFT_OUT = re.compile(
    r"grpclib/(plugin|health|reflection|channelz|testing|server)\b|/(testdata|pyext|compiler|util)/"
    r"|_benchmark\.py|testing_refleaks|\.pyi$|\.typed$|\.proto$"
    r"|google/protobuf/(proto_json|proto_text|proto_builder|service_reflection)\.py"
)
# Files that the add-on shares with the Python package.
SHARED = ("client.py", "recording.py")
# Symbols, references and spellings of the schema's comments, and their replacements in tooltips.
ARTIST = [
    (r", mu_k ?/ ?mu_s\b", ""),
    (r" \((?:the paper|[A-Z]\w+ (?:et al\.|and \w+) \d{4})\)", ""),
    (r"\bEq\. \d+ of the paper, ([^,]+),", r"\1"),
    (r"\b[Tt]he paper's Eq\. \d+", "The paper's formula"),
    (r",? ?\(?\bEqs?\. \d+(?:(?:, | and |-)\d+)*\)?", ""),
    (r"\bmu_k\b", "kinetic friction"),
    (r"\bmu_s\b", "static friction"),
    (r"\brelative to d\b", "in prop diameters"),
    (r"\bin d per\b", "in prop diameters per"),
    (r"\bin d\b", "in prop diameters"),
    (r"([\d.]) d\b(?!/)", r"\1 prop diameters"),
    (r"\bd/(\d+)\b", r"1/\1 of a prop diameter"),
    (r"\bnatural time", "characteristic time"),
    (r"\bagainst the control mesh\b", "against the shape as modeled"),
    (r"\bcontrol mesh\b", "shape"),
    (r"\(see contact_frequency\)", "(see “Stiffness”)"),
    (r"\^2", "²"),
    (r"\^3", "³"),
    (r"odelled\b", "odeled"),
    (r"eighbour", "eighbor"),
    (r"\bmetre", "meter"),
    (r" \((?:Hsu & Keyser)[^)]*\)", ""),
    (r"^Hsu & Keyser \(2012\), Table 1, literal and in SI", "As in the paper that the method comes from"),
    (r"\bvolume IoU\b", "overlap of the volumes"),
    (r", sqrt\([^)]*\) <= mu fn", ""),
    (r"olour", "olor"),
]
# Fixed, so that the same sources give the same zip.
ZIP_TIME = (2020, 1, 1, 0, 0, 0)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--server", type=Path, metavar="FILE", help="the program `cairn` to put inside")
    parser.add_argument("--output", type=Path, metavar="FOLDER", default=ROOT / "target" / "addon")
    args = parser.parse_args()
    output = args.output.resolve()
    version = checked_version()

    package = output / "cairn"
    shutil.rmtree(package, ignore_errors=True)
    shutil.copytree(ADDON / "cairn", package, ignore=shutil.ignore_patterns("__pycache__"))
    vendor(output / "wheels", package / "_vendor")
    share(package)
    describe(output, package)
    kind = "any"
    if args.server:
        server = kind_of(args.server)
        kind = f"{server.system}-{server.machine}"
        include(args.server, package / "bin" / server.program)
        only_on(kind, package / "blender_manifest.toml")
    path = output / f"cairn-{version}-{kind}.zip"
    pack(package, path)
    print(path)


def checked_version():
    """The workspace's version, which the add-on's two manifests have to have."""
    version = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]
    manifest = tomllib.loads((ADDON / "cairn" / "blender_manifest.toml").read_text())["version"]
    legacy = re.search(r'"version": \(([\d, ]+)\)', (ADDON / "cairn" / "__init__.py").read_text())[1]
    if not version == manifest == legacy.replace(", ", "."):
        sys.exit(
            f"Cargo.toml has version {version}, blender_manifest.toml {manifest}, bl_info {legacy}: make them equal."
        )
    return version


def vendor(wheels, target):
    """Unpacks the libraries below the add-on's package, where no other add-on's versions meet them."""
    only = ["--no-deps", "--require-hashes", "--only-binary", ":all:", "--platform", "any"]
    shutil.rmtree(wheels, ignore_errors=True)
    subprocess.run([*PIP, "download", *only, "--dest", wheels, "--requirement", ADDON / "vendor.txt"], check=True)
    for wheel in sorted(wheels.glob("*.whl")):
        with zipfile.ZipFile(wheel) as archive:
            for name in archive.namelist():
                place = vendored_place(name)
                if place:
                    (target / place).parent.mkdir(parents=True, exist_ok=True)
                    (target / place).write_bytes(archive.read(name))
    for folder in [target, *(target / name for name in ("google", "google/rpc"))]:
        (folder / "__init__.py").touch()
    for path in sorted(target.rglob("*.py")):
        path.write_text(relative_imports(path, target, vendored_names(target)))


def share(package):
    """Copies the files that the add-on shares with the Python package."""
    for name in SHARED:
        path = package / name
        shutil.copy(ROOT / "python" / "cairn" / "wire" / name, path)
        path.write_text(relative_imports(path, package, vendored_names(package / "_vendor"), "_vendor."))


def vendored_names(target):
    return {path.stem for path in target.iterdir()} - {"licences", "__init__"}


def vendored_place(name):
    """Where a wheel's file goes; None if it is left out."""
    info = re.match(r"([^/]+)-[^/-]+\.dist-info/(?:licenses/)?(.+)", name)
    if info:
        return f"licences/{info[1]}-{Path(info[2]).name}" if re.search("licen[cs]e", info[2], re.I) else None
    if name.startswith("google/") and not re.match(r"google/(protobuf/|rpc/(status|error_details)_pb2)", name):
        return None
    return None if LEFT_OUT.search(name) or not name.endswith(".py") else name


def relative_imports(path, target, names, inside=""):
    """A source with the imports of the libraries relative to itself: it may be anywhere then. `inside`: where they are
    in `target`."""
    lines = path.read_text().splitlines(keepends=True)
    dots = "." * len(path.relative_to(target).parts)
    for node in ast.walk(ast.parse("".join(lines))):
        if isinstance(node, ast.ImportFrom) and not node.level and node.module.split(".")[0] in names:
            old, new = f"from {node.module} import", f"from {dots}{inside}{node.module} import"
        elif isinstance(node, ast.Import) and any(alias.name.split(".")[0] in names for alias in node.names):
            (alias,) = node.names
            package, _, last = alias.name.rpartition(".")
            rename = f" as {alias.asname}" if alias.asname else ""
            old = f"import {alias.name}{rename}"
            new = f"from {dots}{inside}{package} import {last}{rename}"
            if package and not rename:
                new += f" as _; from {dots} import {package.split('.')[0]}"
        else:
            continue
        line = lines[node.lineno - 1]
        if old not in line:
            sys.exit(f"{path}:{node.lineno}: this import is written in a way that is not known: {line}")
        lines[node.lineno - 1] = line.replace(old, new)
    return "".join(lines)


def describe(output, package):
    """Writes the messages' descriptors, and what the panels say of the scene's fields."""
    buf = Path(shutil.which("buf") or output / "buf" / "bin" / "buf")
    if not buf.exists():
        subprocess.run([*PIP, "install", "--target", output / "buf", BUF], check=True)
    image = output / "descriptors.binpb"
    subprocess.run([buf, "build", ROOT / "proto", "--as-file-descriptor-set", "--output", image], check=True)
    sys.path.insert(0, str(package))
    from _vendor.google.protobuf import descriptor_pb2

    files = descriptor_pb2.FileDescriptorSet.FromString(image.read_bytes())
    (package / "fields.json").write_text(json.dumps(fields(files), indent=1) + "\n")
    for file in files.file:
        file.ClearField("source_code_info")
    (package / "descriptors.binpb").write_bytes(files.SerializeToString(deterministic=True))
    for cache in package.rglob("__pycache__"):
        shutil.rmtree(cache)


def fields(files):
    """Each message's plain fields with meaning, range and default, from the comments that the schema's test holds."""
    enums, messages = {}, {}
    for file in files.file:
        if not file.name.endswith(("scene.proto", "params.proto")):
            continue
        comments = {tuple(place.path): place.leading_comments for place in file.source_code_info.location}
        for number, enum in enumerate(file.enum_type):
            prefix = re.sub(r"(?<!^)(?=[A-Z])", "_", enum.name).upper() + "_"
            items = [
                [value.name.removeprefix(prefix), tooltip(text(comments, (5, number, 2, index))), value.number]
                for index, value in enumerate(enum.value)
                if value.number
            ]
            enums[f".{file.package}.{enum.name}"] = prefix, text(comments, (5, number)), items
        for number, message in enumerate(file.message_type):
            messages[message.name] = [
                (message, field, of_choice(comments, number, field) + text(comments, (4, number, 2, index)))
                for index, field in enumerate(message.field)
            ]
    return {
        name: [entry for message, field, comment in rows if (entry := describe_field(message, field, comment, enums))]
        for name, rows in sorted(messages.items())
    }


def of_choice(comments, number, field):
    """What the fields say of which one at most is set; each field's own comment does not say it again."""
    if not field.HasField("oneof_index") or field.proto3_optional:
        return ""
    return text(comments, (4, number, 8, field.oneof_index)).removesuffix(".") + ". "


def text(comments, path):
    return " ".join(comments.get(path, "").split())


def tooltip(comment):
    """A comment of the schema as Blender shows it: in an artist's words, US English, without a final full stop."""
    for pattern, words in ARTIST:
        comment = re.sub(pattern, words, comment)
    # A parameter or a value by its label, as far as its name is one; a default by as many digits as matter.
    comment = re.sub(r"`(?:\w+\.)?(\w+)`", lambda found: f"“{label(found[1])}”", comment)
    comment = re.sub(r"\b[a-z]+_[a-z]+\b", lambda found: label(found[0]), comment)
    comment = re.sub(r"\b0\.[1-9]\d{4,}", lambda found: f"{float(found[0]):.3g}", comment)
    return comment.removesuffix(".")


def label(name):
    """A field's label in the panels, without its unit."""
    return TITLES.get(name, name.replace("_", " ").title()).split(" (")[0]


def titles():
    """The labels of `schema.py`, which needs Blender to be imported."""
    for node in ast.parse((ADDON / "cairn" / "schema.py").read_text()).body:
        if isinstance(node, ast.Assign) and node.targets[0].id == "TITLES":
            return ast.literal_eval(node.value)
    sys.exit("addon/cairn/schema.py has no TITLES.")


TITLES = titles()


def describe_field(message, field, comment, enums):
    kinds = {1: "float", 3: "int", 5: "int", 8: "bool", 14: "enum"}
    if field.label == field.LABEL_REPEATED or field.type not in kinds or field.options.deprecated:
        return None
    entry = {"name": field.name, "kind": kinds[field.type], "description": tooltip(comment)}
    if field.type == field.TYPE_ENUM:
        entry["prefix"], meaning, entry["items"] = enums[field.type_name]
        # Most comments are complete without the enum's meaning.
        is_said = not comment.startswith("Default:")
        entry["description"] = tooltip(comment if is_said else f"{meaning} {comment}")
    limits = re.search(r"Range: (?:above )?(-?[\d.]*\d)(?: to (-?[\d.]*\d))?", comment)
    if limits:
        entry["min"] = float(limits[1])
        entry["max"] = float(limits[2]) if limits[2] else None
    default = re.search(r"Default: (\S+?)[.,;]?(?:\s|$)", comment)
    entry["default"] = default[1] if default else None
    if field.HasField("oneof_index") and not field.proto3_optional:
        entry["choice"] = message.oneof_decl[field.oneof_index].name
    return entry


def only_on(platform, manifest):
    manifest.write_text(manifest.read_text().replace("[permissions]", f'platforms = ["{platform}"]\n\n[permissions]'))


def pack(package, path):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for file in sorted(package.rglob("*")):
            if file.is_file() and "__pycache__" not in file.parts:
                entry = zipfile.ZipInfo(str(file.relative_to(package.parent).as_posix()), ZIP_TIME)
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.external_attr = (0o100755 if file.parent.name == "bin" else 0o100644) << 16
                archive.writestr(entry, file.read_bytes())


if __name__ == "__main__":
    main()

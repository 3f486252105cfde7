#!/usr/bin/env python3
"""What a farm's task needs, from the estimates of `cairn plan`: memory, cores and time.

    sbatch $(examples/farm/requests.py SCENE --each 4) --array=0-15 examples/farm/slurm.sh SCENE piles 0..63 4
    examples/farm/requests.py SCENE --each 4 --openjd examples/farm/openjd/template.yaml >bundle/template.yaml
    examples/farm/requests.py SCENE --each 4 --json

Of ten bakes, nine take less than is asked for. A farm ends what takes more: give more by hand then. The time is that
of this machine's cores.
"""

import argparse
import json
import math
import re
import subprocess

# Of a task besides its bakes, s: start, files on a network.
START = 120
MIB = 1 << 20
# A bake's limit (--max-memory-mib) counts addresses, of which a program reserves more than it uses; the least limit.
RESERVED, LEAST = 256, 512


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", help="scene file")
    parser.add_argument("--each", type=int, default=1, help="bakes of a task [default: 1]")
    parser.add_argument("--jobs", type=int, default=2, help="bakes that a task runs at once, a core each [default: 2]")
    parser.add_argument("--program", default="cairn", help="[default: cairn]")
    parser.add_argument("--accuracy", help="other than the scene's")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--openjd", metavar="TEMPLATE", help="print this template with the requests in its step `Bake`")
    form.add_argument("--json", action="store_true", help="print cores, memory_mib (of all bakes at once) and seconds")
    args = parser.parse_args()

    needs = request(args)
    if args.json:
        print(json.dumps(needs))
    elif args.openjd:
        with open(args.openjd) as file:
            print(filled(file.read(), needs), end="")
    else:
        per_core = math.ceil(needs["memory_mib"] / needs["cores"])
        minutes = math.ceil(needs["seconds"] / 60)
        print(f"--cpus-per-task={needs['cores']} --mem-per-cpu={per_core}M --time={minutes}")


def request(args):
    accuracy = ["--accuracy", args.accuracy] if args.accuracy else []
    command = [args.program, "plan", args.scene, *accuracy, "--json"]
    bake = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)["resources"]
    jobs = min(args.jobs, args.each)
    rounds = math.ceil(args.each / jobs)
    return {
        "cores": jobs,
        "memory_mib": jobs * max(math.ceil(bake["most_memory_bytes"] / MIB) + RESERVED, LEAST),
        "seconds": math.ceil(rounds * bake["most_seconds"]) + START,
    }


def filled(template, needs):
    """The template's text, its comments included, with other numbers in the step `Bake`."""
    head, name, rest = template.partition("- name: Bake\n")
    bake, end, others = rest.partition("- name: Rank\n")
    for pattern, value in [
        (r"(amount\.worker\.vcpu, min: )\d+", needs["cores"]),
        (r"(amount\.worker\.memory, min: )\d+", needs["memory_mib"]),
        (r"(timeout: )\d+", needs["seconds"]),
    ]:
        bake, count = re.subn(pattern, rf"\g<1>{value}", bake)
        if count != 1:
            raise SystemExit(f"the template's step `Bake` has {count} places like {pattern}")
    return head + name + bake + end + others


if __name__ == "__main__":
    main()

"""The table of what compare.py has found, as Markdown."""

import json
from statistics import median

from entries import BASELINES, OURS, PEERS

HEAD = [
    "engine",
    "settings",
    "CPU s",
    "times held",
    "times glued",
    "shape kept",
    "p95 height kept",
    "penetration mean",
    "max",
    "steps resisted",
]
SHORT = 1e-6
"""Seconds by which the end of a run may be missed by rounding."""


def read(path):
    return json.loads(path.read_text())


def spread(values, least=""):
    """Median, least and most."""
    if not values:
        return "-"
    middle = f"{least}{number(median(values))}"
    return middle if len(values) == 1 else f"{middle} ({number(min(values))} to {number(max(values))})"


def number(value):
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def quality(figures):
    if not figures.exists():
        return ["-"] * 4
    values = read(figures)
    lost = f" ({values['lost']} lost)" if values["lost"] else ""
    shape = "-" if values["kept_shape"] is None else f"{values['kept_shape']:.3f}{lost}"
    return [shape, f"{values['kept_p95']:.2f}", f"{values['penetration_mean']:.4f}", f"{values['penetration_max']:.3f}"]


def resisted(runs):
    """Steps in which the contacts of a body resisted, mean of the bodies."""
    steps = [run["resisted_steps"] for run in runs if "resisted_steps" in run]
    return [number(median(steps)) if steps else "-"]


def rows_of(folder):
    """A row for each of ours, each baseline and each peer that ran."""
    scene = read(folder / "scene.json")
    seconds = scene["frames"] / scene["fps"]
    pairs = {variant: [read(path) for path in sorted(folder.glob(f"round*/*/{variant}.json"))] for variant in OURS}
    for variant in OURS:
        runs = pairs[variant]
        against = {other: [a["cpu"] / b["cpu"] for a, b in zip(runs, pairs[other])] for other in OURS}
        figures = next(iter((folder / "round1").glob(f"*/{variant}.figures.json")), folder / "none")
        ratios = ["1" if other == variant else spread(against[other]) for other in OURS]
        yield [
            "**Cairn**",
            runs[0]["settings"],
            spread([run["cpu"] for run in runs]),
            *ratios,
            *quality(figures),
            *resisted(runs),
        ]
    for name in [*BASELINES, *(peer.name for peer in PEERS)]:
        places = [place for place in sorted(folder.glob(f"round*/{name}")) if (place / "peer.json").exists()]
        if not places:
            continue
        runs = [read(place / "peer.json") for place in places]
        is_cut = any(run["seconds"] < seconds - SHORT - 1 / 60 for run in runs)
        least = "> " if is_cut else ""
        settings = runs[0]["settings"]
        if is_cut:
            settings += f"; stopped after {median(run['seconds'] for run in runs):.2f} s of {seconds:.2f} s"
        ratios = []
        for variant in OURS:
            held = [read(place / f"{variant}.json")["cpu"] for place in places]
            ratios.append(spread([run["cpu"] / ours for run, ours in zip(runs, held)], least))
        cpu = spread([run["cpu"] for run in runs], least)
        yield [runs[0]["engine"], settings, cpu, *ratios, *quality(places[0] / "peer.figures.json"), *resisted(runs)]
        keyed = [run["keyframes_cpu"] for run in runs if "keyframes_cpu" in run]
        if keyed:
            ratios = []
            for variant in OURS:
                held = [read(place / f"{variant}.json")["cpu"] for place in places]
                ratios.append(spread([cpu / ours for cpu, ours in zip(keyed, held)]))
            yield [runs[0]["engine"], "the same, with keyframes", spread(keyed), *ratios, *["-"] * 5]


def markdown(head, rows):
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def section(folder, pile):
    scene = read(folder / "scene.json")
    seconds = scene["frames"] / scene["fps"]
    rounds = len(list(folder.glob("round*")))
    title = f"## {len(scene['bodies'])} {pile.name}, {seconds:.1f} s, rounds: {rounds}"
    return f"{title}\n\n{markdown(HEAD, rows_of(folder))}\n"


def curves(results):
    runs = [read(path) for path in sorted(results.glob("curves/round*.json"))]
    if not runs:
        return []
    ours, bare, theirs = ([run[key] for run in runs] for key in ("ours", "ours_without_report", "blender"))

    def over(some, others):
        return spread([a / b for a, b in zip(some, others)])

    rows = [
        ["Cairn, whole bake by the add-on, fill and report included", spread(ours), "1", over(ours, bare)],
        ["the same without the report", spread(bare), over(bare, ours), "1"],
        [f"Blender {runs[0]['version']}, from turning over", spread(theirs), over(theirs, ours), over(theirs, bare)],
    ]
    title = f"## {runs[0]['bodies']} sticks, {runs[0]['frames']} frames, to finished F-curves"
    return [f"{title}\n\n{markdown(['', 'CPU s', 'times Cairn', 'times it without the report'], rows)}\n"]


def page(results, piles):
    machine = read(results / "machine.json")
    load = ", ".join(f"{part:.1f}" for part in machine["load"])
    about = (
        "# Cairn and its peers, side by side\n\n"
        "The same piles in Cairn and in other engines: CPU time, and how well each keeps the pile's shape. "
        "[How they are measured, and what the rows are](README.md).\n\n"
        "Made by `tests/studies/peers/run` on "
        f"{machine['model']}, {machine['cores']} cores, one thread each; load of the machine at the end: {load}.\n"
        "Median of the rounds, smallest and largest in brackets.\n"
    )
    parts = [section(results / pile.name, pile) for pile in piles]
    return "\n".join([about, *parts, *curves(results)])

"""Numbers from the tables that studies write."""

import re
import subprocess


def value(root, place):
    """The number in a table of a Markdown page. `place`: `page`, `under` (words of the heading above the table), `row`
    (words of its first cells), `column` (of its head)."""
    under, wanted = None, place["under"]
    head = None
    for line in (root / place["page"]).read_text().splitlines():
        if line.startswith("#"):
            under, head = line.lstrip("# "), None
        if under is None or wanted not in under or not line.startswith("|"):
            continue
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if head is None:
            head = cells
        elif place["row"] in " ".join(cells).replace("*", ""):
            found = re.search(r"-?[\d,]+(?:\.\d+)?", cells[head.index(place["column"])])
            if found:
                return float(found.group().replace(",", ""))
    raise SystemExit(f"{place['page']}: no number under “{wanted}” in row “{place['row']}”, column “{place['column']}”")


def day(root, place):
    """When the table was measured, as its page says; else the day on which the page was changed last."""
    said = re.search(r"Measured on (\d{4}-\d\d-\d\d)", (root / place["page"]).read_text())
    if said:
        return said.group(1)
    changed = ["git", "log", "-1", "--format=%cs", "--", place["page"]]
    return subprocess.run(changed, cwd=root, capture_output=True, text=True, check=True).stdout.strip()

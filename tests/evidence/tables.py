"""Numbers from the tables that studies write."""

import re


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

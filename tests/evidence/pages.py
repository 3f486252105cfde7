"""Numbers in pages: `<!--=NAME-->0.97<!--=-->` is the value of the claim NAME, or the table of the block NAME."""

import re
import tomllib
from dataclasses import dataclass

MARK = re.compile(r"<!--=([\w.-]+)-->(.*?)<!--=-->", re.DOTALL)
CLAIM = re.compile(r"\{([\w.-]+)\}")
NUMBER = re.compile(r"(?<![\w.#-])\d[\d,]*(?:\.\d+)?(?![\w-])")
# What is no claim: code, addresses, and pictures.
NOT_TEXT = [
    re.compile(r"^( {4,}|\t).*$", re.MULTILINE),
    re.compile(r"```.*?```", re.DOTALL),
    re.compile(r"`[^`]*`"),
    re.compile(r"\]\([^)]*\)"),
    re.compile(r"<!--.*?-->", re.DOTALL),
]


@dataclass
class Ledger:
    # What pages show of each claim that has been measured.
    shown: dict
    # The claims that a page must state.
    stated: set
    # Tables: `head`, and `rows` of cells, in which `{NAME}` stands for a claim.
    blocks: dict

    def value(self, name):
        """What stands between the marks of a name; None if it has not been measured. And the claims that it states."""
        if name not in self.blocks:
            return self.shown.get(name), {name}
        block = self.blocks[name]
        rows = [block["head"], ["---"] * len(block["head"]), *block["rows"]]
        text = "\n".join("| " + " | ".join(row) + " |" for row in rows)
        names = set(CLAIM.findall(text))
        if not names <= self.shown.keys():
            return None, names
        return f"\n\n{CLAIM.sub(lambda match: self.shown[match[1]], text)}\n\n", names


def stating(root):
    """The pages with marks."""
    found = sorted(path for path in root.glob("**/*.md") if "target" not in path.relative_to(root).parts)
    return [path for path in found if MARK.search(path.read_text())]


def filled(text, page, ledger):
    """The text with the ledger's values, sentences on what is wrong, and the claims that it states."""
    faults, stated = [], set()

    def value(match):
        name, old = match.groups()
        new, names = ledger.value(name)
        stated.update(names)
        if new is None:
            faults.append(f"{page}: “{name}” is no claim, or has not been measured")
            return match.group()
        if new != old:
            faults.append(f"{page}: {name} says {old.strip()}, and {new.strip()} was measured")
        return f"<!--={name}-->{new}<!--=-->"

    return MARK.sub(value, text), faults, stated


def write(root, ledger):
    for path in stating(root):
        text = path.read_text()
        new, faults, _ = filled(text, path.relative_to(root), ledger)
        for fault in faults:
            print(fault)
        if new != text:
            path.write_text(new)
    return 0


def check(root, plain, ledger):
    """Whether pages agree with the ledger, and each number of the pages in `plain` has a claim or a reason."""
    faults, stated = [], set()
    for path in stating(root):
        _, wrong, names = filled(path.read_text(), path.relative_to(root), ledger)
        faults += wrong
        stated |= names
    for name, excuses in tomllib.loads(plain.read_text())["pages"].items():
        faults += of_page(name, (root / name).read_text(), excuses, plain.name)
    faults += [f"no page states the claim {name}" for name in sorted(ledger.stated - stated)]
    for fault in faults:
        print(fault)
    return 1 if faults else 0


def of_page(name, text, excuses, source):
    """What is wrong with a page: numbers without a claim or an excuse, and excuses that the page has no use for."""
    faults = []
    for heading in [words for words in excuses if words.startswith("#")]:
        left = without_section(text, heading)
        if left == text:
            faults.append(f"{source}: {name} no longer has the section “{heading}”")
        text = left
    words = [words for words in excuses if not words.startswith("#")]
    text = prose(text)
    faults += [f"{name}: {number} has no claim: “{near}”" for number, near in unclaimed(text, words)]
    return faults + [f"{source}: {name} no longer says “{one}”" for one in words if one not in text]


def without_section(text, heading):
    """The text without the section below this heading, down to the next heading of its level or a higher one."""
    level = len(heading) - len(heading.lstrip("#"))
    section = re.compile(rf"^{re.escape(heading)}$.*?(?=^#{{1,{level}}} |\Z)", re.DOTALL | re.MULTILINE)
    return section.sub("", text)


def prose(text):
    """What a page says itself, without line breaks."""
    text = MARK.sub("", text)
    for pattern in NOT_TEXT:
        text = pattern.sub(" ", text)
    return re.sub(r"\s+", " ", text)


def unclaimed(text, excuses):
    """Numbers without a claim, each with the words around it."""
    for words in excuses:
        text = text.replace(words, " ")
    for match in NUMBER.finditer(text):
        yield match.group(), text[max(0, match.start() - 30) : match.end() + 20].strip()

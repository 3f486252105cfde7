"""web.py CHROMIUM NODE_MODULES FOLDER: the page of examples/web shows the pack FOLDER/pack with every body where
FOLDER/pile.glb, of which it was made, has it, also between frames, in one draw call for each prop and material. Its
picture becomes FOLDER/web.png."""

import base64
import pathlib
import sys

import browser

TOLERANCE = 1e-3  # m

chromium, modules, work = sys.argv[1:]
example = pathlib.Path(__file__).parents[2] / "examples/web"


def files(path):
    top, _, rest = path.lstrip("/").partition("/")
    match top:
        case "node_modules":
            return pathlib.Path(modules, rest)
        case "work":
            return pathlib.Path(work, rest)
        case "web.js":
            return pathlib.Path(__file__).with_name("web.js")
        case "" | "index.html":
            page = (example / "index.html").read_text()
            return page.replace("</html>", '<script type="module" src="web.js"></script></html>').encode()
    return example / path.lstrip("/")


flags = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--window-size=960,720"]
answer = browser.ask(chromium, files, "index.html?pile=work/pack", flags)
bodies, worst, moved, calls = (answer[name] for name in ("bodies", "worst", "moved", "calls"))
picture = base64.b64decode(answer["picture"].partition(",")[2])
pathlib.Path(work, "web.png").write_bytes(picture)
print(f"three.js {answer['revision']}, by textures: {bodies} bodies within {worst:.1e} m in {calls} draw calls")
if not worst <= TOLERANCE:
    raise SystemExit(f"a body is {worst} m off")
if calls != answer["draws"]:
    raise SystemExit(f"{calls} draw calls, and not {answer['draws']}, one for each prop and material")
if moved < 10 * TOLERANCE:
    raise SystemExit("nothing moves: the comparison says nothing")
if not (answer["shown"] > 1000 and answer["differing"] <= 0.002 * answer["shown"]):
    raise SystemExit(f"the picture shows {answer['shown']} elements of the pile, and {answer['differing']} others")

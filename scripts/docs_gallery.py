"""docs/gallery.md and its pictures: shipped problems solved as a user solves them, each with what was printed.

    python scripts/docs_gallery.py [--check] [NAME ..]      all of GALLERY if none is named; others keep what they have

With --check nothing is written: costs and bounds must be those that the page shows, to SAME of themselves.

The site shows what stands in docs; nothing is solved while it is built.
"""

from __future__ import annotations

import contextlib
import io
import re
import sys
import tempfile
from pathlib import Path

from PIL import Image

from occontrol.cli import run

ROOT = Path(__file__).resolve().parents[1]
PICTURES, PAGE = ROOT / "docs" / "figures" / "gallery", ROOT / "docs" / "gallery.md"
WIDTH = 1000  # pixels
SAME = 1e-3  # other versions of the libraries below stop elsewhere within the target gap
GALLERY = (
    "tracking_network", "battery_lidar", "reactor_assays", "five_targets", "lotka_design", "orbit_stations",
    "oshman_example", "turning_target", "robust_oscillator", "space_object",
)  # fmt: skip
HEAD = """\
# Gallery

Shipped problems, solved by the commands shown, with what they print and the first picture that they draw. Made by
`python scripts/docs_gallery.py`; `occontrol init --example NAME` writes the file of each.
"""


def about(name: str) -> str:
    """The remark at the head of a problem file, up to its first full stop."""
    words = []
    for line in (ROOT / "problems" / f"{name}.yaml").read_text(encoding="utf-8").splitlines():
        if line.startswith("# yaml-language-server"):
            continue
        if not line.startswith("#"):
            break
        words.append(line.lstrip("# ").strip())
    return re.split(r"(?<=[.?])\s", " ".join(words).strip() + " ")[0].strip()


def solved(name: str, folder: Path) -> str:
    """What `occontrol solve` prints for a problem, run into `folder`."""
    told = io.StringIO()
    with contextlib.redirect_stdout(told):
        code = run(["solve", str(ROOT / "problems" / f"{name}.yaml"), "--out", str(folder / name)])
    if code != 0:
        sys.exit(f"{name} ends with {code}")
    # seconds are the machine's own
    lines = [re.sub(r", [0-9.]+ s$", "", line) for line in told.getvalue().splitlines()]
    return "\n".join(line for line in lines if not line.startswith(("written", "seconds")))


def draw(name: str, folder: Path) -> None:
    """The first picture of a run goes to docs, made smaller."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    with Image.open(folder / name / "figures" / "overview.png") as picture:
        size = (WIDTH, round(picture.height * WIDTH / picture.width))
        small = picture.convert("RGB").resize(size, Image.Resampling.LANCZOS)
    small.quantize(128, dither=Image.Dither.NONE).save(PICTURES / f"{name}.png", optimize=True)


def numbers(text: str) -> dict[str, float]:
    """The first number of every line on cost, objective, trace, bound or average, by these words."""
    found = re.findall(r"^ *(cost|objective|trace|lower bound|average RMS)\s+(-?[0-9.]+(?:e[-+]?\d+)?)", text, re.M)
    return {word: float(value) for word, value in found}


def differs(name: str, shown: str, printed: str) -> str:
    """What the page says and a solve does not; empty where they agree."""
    one, other = numbers(shown), numbers(printed)
    wrong = [
        f"{name}: {word} is {other.get(word)}, the page says {value}"
        for word, value in one.items()
        if not abs(other.get(word, float("inf")) - value) <= SAME * abs(value)
    ]
    return "\n".join(wrong) if one else f"{name}: the page shows no number"


def section(name: str, printed: str) -> str:
    """One problem on the page."""
    lines = (f"$ occontrol solve problems/{name}.yaml", *printed.split("\n"))
    body = "\n".join(f"    {line}".rstrip() for line in lines)
    link = f"[{name}.yaml](../problems/{name}.yaml)"
    return f"## {name}\n{about(name)} {link}\n\n{body}\n\n![{name}](figures/gallery/{name}.png)\n"


def main(words: list[str]) -> int:
    """Solve what is named and write the page."""
    checked = "--check" in words
    words = [name for name in words if name != "--check"]
    if unknown := [name for name in words if name not in GALLERY]:
        print(f"not in the gallery: {', '.join(unknown)}", file=sys.stderr)
        return 2
    kept, wrong = {}, []
    if PAGE.exists():
        for part in PAGE.read_text(encoding="utf-8").split("\n## ")[1:]:
            kept[part.split("\n", 1)[0]] = f"## {part.rstrip()}\n"
    with tempfile.TemporaryDirectory() as folder:
        for name in words or GALLERY:
            printed = solved(name, Path(folder))
            if checked:
                wrong += filter(None, [differs(name, kept[name], printed)])
            else:
                draw(name, Path(folder))
                kept[name] = section(name, printed)
            print(name, flush=True)
    if checked:
        print("\n".join(wrong), file=sys.stderr)
        return min(1, len(wrong))
    PAGE.write_text("\n".join([HEAD, *(kept[name] for name in GALLERY if name in kept)]), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

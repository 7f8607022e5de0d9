"""Executes the notebooks of this folder, and holds what they print against what is stored in them.

`python execute.py [--write] [NAME...]`: `--write` stores what was printed and drawn. An error in a cell, a
word that differs, a number that differs by more than another processor makes of it, or a drawing that is not
there is said, and the exit status is 1.
"""

import argparse
import re
import sys
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

HERE = Path(__file__).resolve().parent
LARGEST = 300_000
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[-+]?\d+)?")
# numbers agree to so much of themselves, or to so many units of the last digit that is printed
SHARE, LAST = 5e-3, 2.0


def executed(notebook):
    """The notebook as it comes out of a fresh kernel, without what is of one run only."""
    fresh = nbformat.from_dict(notebook)
    for cell in fresh.cells:
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    where = {"metadata": {"path": str(HERE)}}
    client = NotebookClient(fresh, timeout=1200, resources=where)
    client.execute()
    fresh.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    for cell in fresh.cells:
        cell.metadata = {}
        if cell.cell_type == "code":
            # a line of progress that was taken away leaves an empty one
            cell.outputs = [o for o in cell.outputs if o.get("data") != {"text/plain": ""}]
    return fresh


def told(cell):
    """What a cell shows: its text, and kinds of drawings."""
    out = []
    for o in cell.get("outputs", []):
        data = o.get("data", {})
        drawn = [kind for kind in data if kind.startswith("image/")]
        # what stands for a drawing in a terminal says nothing
        text = "" if drawn else o.get("text", data.get("text/plain", ""))
        out.append("\n".join([o.get("name", ""), *text.split("\n"), *drawn]))
    return "\n".join(out)


def alike(one, other):
    """Whether two numbers, as they are printed, agree."""
    digits = [len(n.split("e")[0].partition(".")[2]) for n in (one, other)]
    scale = 10.0 ** int(one.partition("e")[2] or 0)
    gap = abs(float(one) - float(other))
    return gap <= max(SHARE * abs(float(one)), LAST * scale * 10.0 ** -min(digits))


def differs(stored, now):
    """What the outputs of a cell differ in; None where they agree."""
    words = [" ".join(NUMBER.sub("#", text).split()) for text in (stored, now)]
    if words[0] != words[1]:
        return f"stored:\n{stored}\nnow:\n{now}"
    pairs = zip(NUMBER.findall(stored), NUMBER.findall(now))
    gaps = [f"{a} was stored, now it is {b}" for a, b in pairs if not alike(a, b)]
    return "\n".join(gaps) or None


def faults(path, write):
    """What is wrong with a notebook."""
    stored = nbformat.read(path, as_version=4)
    begun = time.perf_counter()
    try:
        fresh = executed(stored)
    except CellExecutionError as error:
        return [str(error)]
    took = time.perf_counter() - begun
    out = []
    for k, (was, now) in enumerate(zip(stored.cells, fresh.cells), 1):
        if any(o.get("name") == "stderr" for o in now.get("outputs", [])):
            out.append(f"cell {k} warns: {told(now)}")
        if not write and (gap := differs(told(was), told(now))):
            out.append(f"cell {k}: {gap}")
    if write:
        nbformat.validate(fresh)
        nbformat.write(fresh, path)
    size = path.stat().st_size
    if size > LARGEST:
        out.append(f"{size} bytes, at most {LARGEST}")
    print(f"{path.name}: {took:.0f} s, {size / 1000:.0f} kB", flush=True)
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--write", action="store_true", help="stores what is printed and drawn")
    parser.add_argument("names", nargs="*", help="notebooks; all where none is named")
    asked = parser.parse_args()
    paths = [HERE / Path(name).name for name in asked.names] or sorted(HERE.glob("*.ipynb"))
    found = {path.name: faults(path, asked.write) for path in paths}
    for name, wrong in found.items():
        for fault in wrong:
            print(f"{name}: {fault}", file=sys.stderr)
    wrong = sum(1 for each in found.values() if each)
    print(f"{len(found) - wrong} passed, {wrong} failed")
    sys.exit(1 if wrong or not found else 0)


if __name__ == "__main__":
    main()

"""Writes golden.json, the program's numbers: `python tests/golden.py PROGRAM`, with the wheel installed."""

import json
import sys
import tempfile
from pathlib import Path

import bench

FILE = Path(__file__).with_name("golden.json")


def main(program):
    out = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, (arguments, _) in bench.ON_DATA.items():
            said = bench.ask(program, arguments, Path(folder) / name)
            keys = ["value", "std_error"]
            out[name] = {p: [v[k] for k in keys] for p, v in said["parameters"].items()}
    FILE.write_text(json.dumps(out, indent=1) + "\n")


if __name__ == "__main__":
    main(sys.argv[1])

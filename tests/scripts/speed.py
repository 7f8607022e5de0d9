"""Times `deacal import` on large files, whole process, against the Python reader of the same format: speed.py DEACAL FOLDER [MEGABYTES].

Files are made in FOLDER where they are not there yet: 1000 MB each of Nexus CSV, delimited text and MCAP, and smaller ones for readers that
would take too long. Needs numpy, pandas, ezc3d, mcap, mcap-ros2-support and zstandard. Prints wall and processor seconds, MB/s and the
largest resident memory of every process, beside what `sha256sum` and `wc -l` take for the same file.
"""

import os
import subprocess
import sys
import time

import numpy

program, folder = sys.argv[1], sys.argv[2]
large = int(sys.argv[3]) if len(sys.argv) > 3 else 1000
here = os.path.dirname(os.path.abspath(__file__))
generator = numpy.random.default_rng(1)


def tails(columns, digits):
    """A thousand ends of rows, without what counts them."""
    walk = numpy.cumsum(generator.normal(0, 0.05, (1000, columns)), axis=0) + generator.uniform(-500, 500, columns)
    return ["," + ",".join(f"{v:.{digits}f}" for v in row) + "\n" for row in walk]


def nexus(path, megabytes):
    labels = [f"DEA:M{i + 1}" for i in range(12)]
    ends = tails(3 * len(labels), 3)
    with open(path, "w") as out:
        out.write("Trajectories\n200\n,," + ",,,".join(labels) + ",,\n")
        out.write("Frame,Sub Frame" + ",X,Y,Z" * len(labels) + "\n,," + ",".join(["mm"] * 3 * len(labels)) + "\n")
        frame = 0
        while out.tell() < megabytes * 1_000_000:
            out.write("".join(f"{frame + i + 1},0{end}" for i, end in enumerate(ends)))
            frame += len(ends)


def delimited(path, megabytes):
    ends = tails(6, 4)
    with open(path, "w") as out:
        out.write("time_s,phi1_V,phi2_V,phi3_V,m1_V,m2_V,m3_V\n")
        row = 0
        while out.tell() < megabytes * 1_000_000:
            out.write("".join(f"{(row + i) / 1000:.3f}{end}" for i, end in enumerate(ends)))
            row += len(ends)


def c3d(path, megabytes):
    import ezc3d

    file = ezc3d.c3d()
    frames, markers = 60_000, max(1, megabytes * 1_000_000 // (16 * 60_000))
    file["parameters"]["POINT"]["RATE"]["value"] = [200.0]
    file["parameters"]["POINT"]["LABELS"]["value"] = [f"M{i + 1}" for i in range(markers)]
    points = numpy.ones((4, markers, frames))
    points[:3] = numpy.cumsum(generator.normal(0, 0.05, (3, markers, frames)), axis=2) + 300
    file["data"]["points"] = points
    file.write(path)


def mcap(compression):
    def make(path, megabytes):
        script = os.path.join(here, "large_mcap.py")
        subprocess.run([sys.executable, script, path, str(megabytes), compression], check=True)

    return make


def run(command):
    """Wall seconds, processor seconds, largest resident memory in MB."""
    began = time.monotonic()
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(child.pid, 0)
    wall = time.monotonic() - began
    if status:
        sys.exit(f"{command[0]} failed")
    return wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024 / 1e6


PANDAS = "import pandas, sys; pandas.read_csv(sys.argv[1], skiprows={}, engine='c')"
EZC3D = "import ezc3d, sys; ezc3d.c3d(sys.argv[1])"
MCAP = """
import sys
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
with open(sys.argv[1], "rb") as stream:
    for _, _, _, m in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
        m.pose.position.x
"""
FILES = [
    ("nexus.csv", large, nexus, PANDAS.format(4)),
    ("table.csv", large, delimited, PANDAS.format(0)),
    ("plain.mcap", large, mcap("none"), None),
    ("plain-small.mcap", 30, mcap("none"), MCAP),
    ("zstd-small.mcap", 10, mcap("zstd"), MCAP),
    ("markers.c3d", 96, c3d, EZC3D),
]
print(f"{'file':18} {'MB':>6}  {'process':14} {'wall s':>7} {'cpu s':>7} {'MB/s':>6} {'MB held':>8}")
for name, megabytes, make, reader in FILES:
    path = os.path.join(folder, name)
    if not os.path.exists(path):
        make(path, megabytes)
    size = os.path.getsize(path) / 1e6
    out = os.path.join(folder, "out")
    processes = [("deacal import", [program, "import", path, "-o", out])] * 3
    processes += [("sha256sum", ["sha256sum", path]), ("wc -l", ["wc", "-l", path])]
    if reader:
        processes.append(("Python reader", [sys.executable, "-c", reader, path]))
    best = {}
    for title, command in processes:
        result = run(command)
        best[title] = min(best.get(title, result), result)
        wall, cpu, held = result
        print(f"{name:18} {size:6.0f}  {title:14} {wall:7.2f} {cpu:7.2f} {size / wall:6.0f} {held:8.0f}", flush=True)
    if reader:
        ours, theirs = best["deacal import"], best["Python reader"]
        print(f"{name:18} {'':6}  {theirs[0] / ours[0]:.1f} times faster, by processor time {theirs[1] / ours[1]:.1f}")

"""Reads one recording as CSV, .mat, .npz and MCAP with the Python packages scipy, numpy and mcap, and compares the values.

read_arrays.py FOLDER NAME: FOLDER/NAME.csv, .mat, .npz, .mcap. Prints one line; exit status 1 where values differ, 77 where
a package is not installed.
"""

import csv
import json
import os
import sys

try:
    import numpy
    import scipy.io
    from mcap.reader import make_reader
except ImportError:
    sys.exit(77)

base = os.path.join(sys.argv[1], sys.argv[2])
with open(base + ".csv", newline="") as stream:
    rows = list(csv.reader(stream))
table = {name: numpy.array([float(r[i]) if r[i] else numpy.nan for r in rows[1:]]) for i, name in enumerate(rows[0])}
mat = {k: v for k, v in scipy.io.loadmat(base + ".mat").items() if not k.startswith("__")}
npz = numpy.load(base + ".npz")
assert sorted(mat) == sorted(table) == sorted(npz.files), (sorted(mat), sorted(table), sorted(npz.files))
values = 0
for name, column in table.items():
    assert mat[name].shape == (len(column), 1) and npz[name].shape == column.shape, name
    assert numpy.array_equal(mat[name][:, 0], npz[name], equal_nan=True), name
    assert numpy.array_equal(npz[name], column, equal_nan=True), name
    values += len(column)

# MCAP: a message where there is a value, rounded to the digits that it is written with
columns = {
    "/end_effector/measured": (["x_raw_mm", "y_raw_mm", "z_raw_mm"], 1e3, 1e-6),
    "/end_effector/position": (["x_mm", "y_mm", "z_mm"], 1e3, 1e-6),
    "/voltage/command": (["phi1_V", "phi2_V", "phi3_V"], 1, 1e-4),
    "/voltage/predicted": (["phi1_predicted_V", "phi2_predicted_V", "phi3_predicted_V"], 1, 1e-4),
    "/voltage/residual": (["phi1_residual_V", "phi2_residual_V", "phi3_residual_V"], 1, 1e-4),
}
with open(base + ".mcap", "rb") as stream:
    reader = make_reader(stream, validate_crcs=True)
    # a motion clock that begins below zero is shifted by whole seconds
    shift = float(next(m.metadata["time_shift_s"] for m in reader.iter_metadata() if m.name == "deacal"))
    for schema, channel, message in reader.iter_messages():
        if channel.topic not in columns:
            continue
        names, scale, digit = columns[channel.topic]
        body = json.loads(message.data)
        body = body["pose"]["position"] if "pose" in body else body
        i = int(numpy.argmin(abs(table["time_s"] - (message.log_time * 1e-9 - shift))))
        for k, name in enumerate(names):
            key = "xyz"[k] if "x" in body or "y" in body else "chain_%d" % (k + 1)
            if key in body:
                assert abs(body[key] * scale - table[name][i]) <= 0.51 * digit + 1e-12 * abs(table[name][i]), (channel.topic, i)
                values += 1
            else:
                assert numpy.isnan(table[name][i]), (channel.topic, i)
print(values, "values agree")

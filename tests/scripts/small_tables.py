"""Writes the small MATLAB files and workbooks in tests/data/recording: small_tables.py FOLDER. Needs numpy, scipy, h5py and openpyxl."""

import csv
import datetime
import os
import sys

import h5py
import numpy
import openpyxl
import scipy.io

folder = sys.argv[1]

n = 6
t = numpy.arange(n) / 100
effector = numpy.column_stack([10 + t, 20 - t, -60 + 2 * t])
effector[2] = numpy.nan
arrays = {
    "t": t[:, None],
    "EE_mm": effector,
    "phi_kV": numpy.array([[0.5, 1.5, 2.5, 3.5, 4.5, 5.5], [0, 0, 0, 1, 1, 1], [1, 2, 3, 4, 5, 6]]).T,
    "across": numpy.arange(n, dtype=numpy.int16)[None, :],
    "run": {"time_ms": numpy.arange(4.0) * 10, "load": {"F_N": numpy.array([1, -2, 300, 4], dtype=numpy.int32)},
            "on": numpy.array([True, False, True, True])},
    "beyond": numpy.array([1.0, numpy.inf, numpy.nan]),
    "fs": 100.0,
    "note": "nobody",
    "cells": numpy.array([1, "a"], dtype=object),
    "cube": numpy.zeros((2, 2, 2)),
    "wave": numpy.array([1 + 2j, 3]),
}
scipy.io.savemat(os.path.join(folder, "small.mat"), arrays, do_compression=True)
scipy.io.savemat(os.path.join(folder, "plain.mat"), arrays)

# the same table as a sheet and as text
rows = [
    ["Coupon 3, hand-made", None, None, None, None],
    [None, None, None, None, None],
    ["time", "Elongation", "Force (N)", "remark", "when"],
    ["s", "mm", None, None, None],
    [0, 0.0, 0.125, "start", "2026-03-16"],
    [0.1, 0.1234567890123, None, None, None],
    [0.2, 1e-7, "NaN", "a gap", None],
    [0.3, "#N/A", -1.5e20, None, None],
    [0.4, 123456.789, "#DIV/0!", 'says "no", twice', None],
]
with open(os.path.join(folder, "sheet.csv"), "w", newline="") as out:
    csv.writer(out).writerows([["" if c is None else c for c in row] for row in rows])
book = openpyxl.Workbook()
for row in rows:
    book.active.append(row)
book.active["E5"] = datetime.date(2026, 3, 16)
book.save(os.path.join(folder, "sheet.xlsx"))

book = openpyxl.Workbook()
book.active.title = "Notes"
book.active.append(["Measured by nobody"])
for name, header in [("Motion", ["time_s", "EE_x_mm", "EE_y_mm", "EE_z_mm"]), ("Drive", ["time_s", "u1_kV", "u2_kV", "u3_kV"])]:
    sheet = book.create_sheet(name)
    sheet.append(header)
    for i in range(5):
        sheet.append([i / 50, i, 2 * i, 3 * i])
book.save(os.path.join(folder, "sheets.xlsx"))

# level 7.3 with the same numbers, as MATLAB lays it out: HDF5 behind 512 bytes, arrays with their sizes the other way round
path = os.path.join(folder, "small73.mat")
with h5py.File(path, "w", userblock_size=512) as out:
    def put(group, name, value):
        if isinstance(value, dict):
            inner = group.create_group(name)
            inner.attrs["MATLAB_class"] = numpy.bytes_("struct")
            for key, item in value.items():
                put(inner, key, item)
            return
        if isinstance(value, str):
            kind, value = "char", numpy.array([[ord(c)] for c in value], dtype=numpy.uint16)
        else:
            value = numpy.atleast_1d(value)
            kind = {"float64": "double", "bool": "logical", "object": "cell"}.get(value.dtype.name, value.dtype.name)
            value = value[None, :] if value.ndim == 1 else value
            value = value.astype(numpy.uint8) if kind == "logical" else value
        if kind == "cell":
            value = numpy.array([[group.file.ref] * 2], dtype=h5py.ref_dtype)
        elif numpy.iscomplexobj(value):
            kind = "double"
            value = value.view([("real", "<f8"), ("imag", "<f8")])
        more = {} if value.size < 6 or kind == "cell" else {"compression": "gzip", "chunks": True}
        group.create_dataset(name, data=value.T, **more).attrs["MATLAB_class"] = numpy.bytes_(kind)

    for name, value in arrays.items():
        put(out, name, value)
    moments = out.create_dataset("moments", data=numpy.array([[0xDD000000, 2]], dtype=numpy.uint32))
    moments.attrs["MATLAB_class"] = numpy.bytes_("datetime")
    moments.attrs["MATLAB_object_decode"] = numpy.int32(3)
with open(path, "r+b") as out:
    out.write(b"MATLAB 7.3 MAT-file, by small_tables.py".ljust(124) + b"\0\2IM")

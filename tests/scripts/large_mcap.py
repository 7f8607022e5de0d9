"""Writes a large MCAP file of PoseStamped messages (CDR) to measure readers with: large_mcap.py FILE MEGABYTES none|zstd|lz4."""

import struct
import sys
import zlib

import numpy

path, megabytes, compression = sys.argv[1], int(sys.argv[2]), sys.argv[3]
RULE = "=" * 80 + "\n"
SCHEMA = (
    "std_msgs/Header header\ngeometry_msgs/Pose pose\n"
    + RULE + "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    + RULE + "MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"
    + RULE + "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n"
    + RULE + "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
).encode()
RECORD = numpy.dtype([
    ("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8"),
    ("cdr", "S4"), ("sec", "<i4"), ("nanosec", "<u4"), ("size", "<u4"), ("frame", "S6"), ("pad", "S6"), ("pose", "<f8", 7),
])


def string(text):
    data = text if isinstance(text, bytes) else text.encode()
    return struct.pack("<I", len(data)) + data


def record(opcode, body):
    return struct.pack("<BQ", opcode, len(body)) + body


def compressed(data):
    if compression == "zstd":
        import zstandard
        return zstandard.ZstdCompressor(level=1).compress(data)
    if compression == "lz4":
        import lz4.frame
        return lz4.frame.compress(data)
    return data


generator = numpy.random.default_rng(1)
with open(path, "wb") as out:
    out.write(b"\x89MCAP0\r\n" + record(1, string("ros2") + string("")))
    written, first = 0, 0
    while written < megabytes * 1_000_000:
        count = 8000
        rows = numpy.zeros(count, RECORD)
        rows["opcode"], rows["length"], rows["channel"] = 5, RECORD.itemsize - 9, 1
        time = (first + numpy.arange(count)) * 1_000_000
        rows["sequence"], rows["log"], rows["publish"] = first + numpy.arange(count), time, time
        rows["cdr"], rows["sec"], rows["nanosec"] = b"\0\1\0\0", 1 + time // 10**9, time % 10**9
        rows["size"], rows["frame"] = 6, b"world\0"
        rows["pose"][:, :3] = 0.01 * numpy.sin(time[:, None] * 1e-9) + 3e-5 * generator.standard_normal((count, 3))
        rows["pose"][:, 6] = 1
        head = b""
        if first == 0:
            head = record(3, struct.pack("<H", 1) + string("geometry_msgs/msg/PoseStamped") + string("ros2msg") + string(SCHEMA))
            head += record(4, struct.pack("<HH", 1, 1) + string("/ee/pose") + string("cdr") + struct.pack("<I", 0))
        data = head + rows.tobytes()
        packed = compressed(data)
        name = "" if compression == "none" else compression
        chunk = struct.pack("<QQQI", int(time[0]), int(time[-1]), len(data), zlib.crc32(data)) + string(name)
        chunk = record(6, chunk + struct.pack("<Q", len(packed)) + packed)
        out.write(chunk)
        written += len(chunk)
        first += count
    out.write(record(15, struct.pack("<I", 0)) + record(2, struct.pack("<QQI", 0, 0, 0)) + b"\x89MCAP0\r\n")

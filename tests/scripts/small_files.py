"""Writes the small binary recordings in tests/data/recording: small_files.py FOLDER. Needs numpy, npTDMS and mcap."""

import os
import sys

import numpy
from mcap.writer import CompressionType, Writer
from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

folder = sys.argv[1]

with TdmsWriter(os.path.join(folder, "small.tdms")) as out:
    group = GroupObject("run", {"operator": "nobody"})
    clock = {"wf_increment": 0.01, "wf_start_offset": 0.5, "unit_string": "V"}
    volts = ChannelObject("run", "monitor", numpy.array([0.5, 1.5, -2.5]), clock)
    counts = ChannelObject("run", "counts", numpy.array([1, -2, 300], dtype=numpy.int16), dict(clock, unit_string=""))
    words = ChannelObject("run", "words", ["one", "two"])
    scaled = ChannelObject("run", "scaled", numpy.array([1, 2], dtype=numpy.int32), {
        "NI_Scaling_Status": "unscaled", "NI_Number_Of_Scales": 2, "NI_Scale[1]_Scale_Type": "Linear",
        "NI_Scale[1]_Linear_Slope": 0.25, "NI_Scale[1]_Linear_Y_Intercept": 1.0, "NI_Scale[1]_Linear_Input_Source": 0})
    out.write_segment([RootObject({"name": "small"}), group, volts, counts, words, scaled])
    # the same objects again, then some only
    out.write_segment([ChannelObject("run", "monitor", numpy.array([4.0]), clock),
                       ChannelObject("run", "counts", numpy.array([5], dtype=numpy.int16))])

with open(os.path.join(folder, "small.mcap"), "wb") as stream:
    writer = Writer(stream, compression=CompressionType.ZSTD)
    writer.start(profile="ros2", library="tests/scripts/small_files.py")
    schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data\n")
    channel = writer.register_channel("/phi1", "cdr", schema)
    state = writer.register_channel("/state", "json", writer.register_schema("State", "jsonschema", b"{}"))
    for i in range(4):
        data = b"\0\1\0\0" + numpy.float64(i / 4).tobytes()
        writer.add_message(channel, 10**9 + i * 10**7, data, 10**9 + i * 10**7)
        writer.add_message(state, 10**9 + i * 10**7, b'{"x": %d, "list": [1, 2], "things": [{"name": "a", "v": 3}]}' % i, 10**9)
    writer.finish()

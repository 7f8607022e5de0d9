"""Reads an MCAP file with the Python package and prints what is in it, one JSON object.

Exit status 77: the package `mcap` is not installed.
"""

import json
import sys

try:
    from mcap.reader import make_reader
except ImportError:
    sys.exit(77)

with open(sys.argv[1], "rb") as stream:
    reader = make_reader(stream, validate_crcs=True)
    topics = {}
    for schema, channel, message in reader.iter_messages():
        topic = topics.setdefault(
            channel.topic, {"schema": schema.name, "encoding": channel.message_encoding, "count": 0}
        )
        topic["count"] += 1
        topic["last_log_time"] = message.log_time
        topic["last"] = json.loads(message.data)
        json.loads(schema.data)
    metadata = [record.metadata for record in reader.iter_metadata()]
json.dump({"topics": topics, "metadata": metadata}, sys.stdout)

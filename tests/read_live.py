#!/usr/bin/env python3
"""Looks on at a run over Foxglove's WebSocket, as a client of nobody's library, and compares it with the recording.

    pip install mcap mcap-protobuf-support websockets
    python tests/read_live.py ws://127.0.0.1:8765 RECORDING

Subscribes to every topic until the server closes, beside a client that reads nothing and one that goes at once. Prints a
line per topic (messages, schema, topic). The exit status is 1 when a message does not decode, topics or schemas are not
those of the recording, a message is not in it byte for byte, what comes once is not sent to one who is late, or the
server does not close.
"""

import base64
import collections
import functools
import json
import struct
import sys

from mcap.reader import make_reader
from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

PROTOCOL = "foxglove.sdk.v1"
MESSAGE, TIME = 1, 2


def time_of(data):
    return struct.unpack_from("<Q", data, 1)[0]


def subscribe(socket):
    """Subscribes to every topic; returns the channels by subscription, and the times that came before them."""
    assert socket.subprotocol == PROTOCOL, socket.subprotocol
    info = json.loads(socket.recv())
    assert info["op"] == "serverInfo" and "time" in info["capabilities"], info
    # The run goes on meanwhile: its clock may be sent to a client that has not been told the channels yet.
    times = []
    while isinstance(data := socket.recv(), bytes):
        assert data[0] == TIME, data
        times.append(time_of(data))
    advertised = json.loads(data)
    assert advertised["op"] == "advertise", advertised
    channels = {channel["id"]: channel for channel in advertised["channels"]}
    wanted = [{"id": id, "channelId": id} for id in channels]
    socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
    return channels, times


def schema_of(channel):
    data = channel["schema"]
    binary = channel["schemaEncoding"] == "protobuf"
    return base64.b64decode(data) if binary else data.encode()


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    address, recording = sys.argv[1:]
    received = collections.defaultdict(list)
    join = functools.partial(connect, address, subprotocols=[PROTOCOL], max_size=None, close_timeout=1)
    with join() as stalled, join() as vanished, join() as socket:
        subscribe(stalled)
        subscribe(vanished)
        vanished.socket.close()
        channels, times = subscribe(socket)
        try:
            while True:
                data = socket.recv(timeout=60)
                assert isinstance(data, bytes), data
                if data[0] == TIME:
                    times.append(time_of(data))
                elif data[0] == MESSAGE:
                    id, log_time = struct.unpack_from("<IQ", data, 1)
                    received[channels[id]["topic"]].append((log_time, data[13:]))
        except ConnectionClosed as closed:
            assert closed.rcvd is not None, "the connection was cut, not closed"

    factory = DecoderFactory()
    failures = []
    for channel in channels.values():
        schema = Schema(channel["id"], schema_of(channel), channel["schemaEncoding"], channel["schemaName"])
        decode = json.loads
        if channel["encoding"] == "protobuf":
            decode = factory.decoder_for("protobuf", schema)
        messages = received[channel["topic"]]
        for _, data in messages:
            decode(data)
        print(f"{len(messages):>8}  {channel['schemaName']:<28}  {channel['topic']}")

    recorded = {}
    described = {}
    with open(recording, "rb") as file:
        reader = make_reader(file)
        for id, channel in reader.get_summary().channels.items():
            schema = reader.get_summary().schemas[channel.schema_id]
            described[channel.topic] = (channel.message_encoding, schema.encoding, schema.name, schema.data)
            recorded[channel.topic] = set()
        for _, channel, message in reader.iter_messages():
            recorded[channel.topic].add((message.log_time, message.data))
    served = {
        channel["topic"]: (channel["encoding"], channel["schemaEncoding"], channel["schemaName"], schema_of(channel))
        for channel in channels.values()
    }
    if served != described:
        failures.append(f"other topics or schemas: {set(served) ^ set(described)}")
    for topic, messages in received.items():
        foreign = [time for time, data in messages if (time, data) not in recorded.get(topic, ())]
        if foreign:
            failures.append(f"{topic}: {len(foreign)} messages are not in the recording")
    # Sent in the set-up, before anybody was there.
    start = min(time for messages in recorded.values() for time, _ in messages)
    for topic in ["/scene", "/site/location", "/log"]:
        if not any(time == start for time, _ in received[topic]):
            failures.append(f"{topic}: what came once was not sent again")
    if not times or times != sorted(times):
        failures.append(f"the clock: {len(times)} times")
    ended = max(time for messages in recorded.values() for time, _ in messages)
    if not any(time == ended for time, _ in received["/boresight/tick"]):
        failures.append("the last tick did not come")
    for failure in failures:
        print("FAILED", failure, file=sys.stderr)
    if failures:
        sys.exit(f"{len(failures)} failures")


if __name__ == "__main__":
    main()

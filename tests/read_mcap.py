#!/usr/bin/env python3
"""Reads a recording with an independent reader and decodes every message of it.

    pip install mcap mcap-protobuf-support
    python tests/read_mcap.py RECORDING

Prints a line per topic (messages, schema, topic), the attachments and metadata, and the number of
decoded messages. The exit status is 1 when anything fails to decode, a checksum is wrong, a channel's
sequence has a gap, log times run backwards, or a complete file's index disagrees with its messages.
A recording of a killed run is read up to the cut and called truncated, which is no failure.
"""

import collections
import json
import struct
import sys

from mcap.exceptions import EndOfFile, InvalidMagic
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory


def read(path):
    """Returns the lines to print and the list of failures."""
    schemas, channels, decoders = {}, {}, {}
    counts, next_sequence = collections.Counter(), collections.Counter()
    extras, failures = [], []
    last_time = 0
    first_time = None
    complete = False
    factory = DecoderFactory()

    with open(path, "rb") as file:
        # The stream reader goes from the front and needs no index, so a cut file is readable too.
        records = StreamReader(file, validate_crcs=True).records
        while True:
            try:
                record = next(records, None)
            except (EndOfFile, InvalidMagic, struct.error) as error:
                if not counts and not extras:
                    failures.append(f"no recording: {error!r}")
                break
            except Exception as error:  # decompression, checksum: each library has its own
                failures.append(f"damaged: {error!r}")
                break
            if record is None:
                complete = True
                break
            if isinstance(record, Header):
                extras.append(f"header: profile {record.profile!r}, library {record.library!r}")
            elif isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Attachment):
                extras.append(f"attachment: {record.name}, {len(record.data)} bytes")
            elif isinstance(record, Metadata):
                extras.append(f"metadata: {record.name} {record.metadata}")
            elif isinstance(record, Message):
                channel = channels[record.channel_id]
                try:
                    schema = schemas[channel.schema_id]
                    if channel.message_encoding == "json":
                        known = json.loads(schema.data)["properties"]
                        unknown = set(json.loads(record.data)) - set(known)
                    else:
                        if channel.id not in decoders:
                            decoder = factory.decoder_for(channel.message_encoding, schema)
                            decoders[channel.id] = decoder
                        unknown = _unknown_fields(decoders[channel.id](record.data))
                    if any(unknown):
                        raise ValueError("field that its schema does not know")
                except Exception as error:  # whatever it is, the message cannot be used
                    failures.append(f"{channel.topic} #{record.sequence}: {error!r}")
                if record.sequence != next_sequence[channel.id]:
                    failures.append(f"{channel.topic}: #{record.sequence} out of sequence")
                next_sequence[channel.id] = record.sequence + 1
                if record.log_time < last_time:
                    failures.append(f"{channel.topic} #{record.sequence}: time runs backwards")
                last_time = record.log_time
                first_time = record.log_time if first_time is None else first_time
                counts[channel.id] += 1

    if complete:
        with open(path, "rb") as file:
            summary = make_reader(file).get_summary()
        stats = summary.statistics if summary else None
        if stats is None or dict(stats.channel_message_counts) != dict(counts):
            failures.append("the index disagrees with the messages")

    lines = extras
    lines += [
        f"{counts[id]:>8}  {schemas[channel.schema_id].name:<28}  {channel.topic}"
        for id, channel in sorted(channels.items())
    ]
    seconds = (last_time - (first_time or 0)) * 1e-9
    lines.append(f"{'complete' if complete else 'truncated'}, {seconds:.3f} s")
    lines.append(f"{sum(counts.values())} messages decoded")
    return lines, failures


def _unknown_fields(message):
    """Yields every field in the message, at any depth, that its schema does not describe."""
    from google.protobuf.unknown_fields import UnknownFieldSet

    yield from UnknownFieldSet(message)
    for field, value in message.ListFields():
        if field.type == field.TYPE_MESSAGE:
            for part in value if isinstance(value, collections.abc.Sequence) else [value]:
                yield from _unknown_fields(part)


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    lines, failures = read(sys.argv[1])
    print("\n".join(lines))
    for failure in failures[:20]:
        print("FAILED", failure, file=sys.stderr)
    if failures:
        sys.exit(f"{len(failures)} failures")


if __name__ == "__main__":
    main()

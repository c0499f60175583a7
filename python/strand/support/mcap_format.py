"""Kinds and layouts of the records in MCAP files, for reading and for writing."""

from __future__ import annotations

from struct import Struct

MAGIC = b"\x89MCAP0\r\n"  # how a file begins and ends
# kinds of records
HEADER = 1
FOOTER = 2
SCHEMA = 3
CHANNEL = 4
MESSAGE = 5
CHUNK = 6
MESSAGE_INDEX = 7
CHUNK_INDEX = 8
STATISTICS = 11
DATA_END = 15
RECORD = Struct("<BQ")  # kind and size
CHUNK_HEAD = Struct("<QQQI")  # times of its first and last message, size, checksum

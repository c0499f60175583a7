"""Parquet files: the memory of one by the headers of its pages, which may declare anything, and its seal.

Pages have checksums, but the footer has none, and pyarrow ends the process at some damaged footers. A seal of
eight bytes before the footer has its checksum. Other readers skip it.
"""

from __future__ import annotations

import os
import zlib
from typing import Any, BinaryIO

from strand.support.files import read_at

_MARK = b"PAR1"
_END = 8  # bytes after the footer: its length and the mark
_SEAL = b"SEAL"  # before the checksum of the footer
_FOOTER = 2048  # bytes that a byte of the footer may take
_PAGE = 1 << 16  # bytes counted for a page; this bounds the time for their headers
_VALUE = 24  # bytes that levels, offsets and a value take
_OBJECT = 96  # bytes of a value as a Python object, with its share of lists
_CONTENT = 3  # bytes of a byte of a page: compressed and not, and in the column
_TEXT = 2  # more of them as Python objects
_DATA_PAGE = 0
_ENCODINGS = (0, 3)  # plain values, and booleans in runs; strand writes no dictionaries
_STRUCT = 12  # type of a struct
_LENGTHS = {3: 1, 7: 8}  # bytes of a value by its type: a byte, a double
_MAX_DEPTH = 4  # of structs in a header
_COPIES = 4  # bytes of a byte of the largest page: compressed, not compressed, in the column, and its copy
_DICTIONARY = 2  # the kind of a page
_HEADER = 1 << 16  # bytes that the header of a page may take
_VALUE_PLACES = {0: 5, 3: 8}  # the field with the number of values of a data page of version 1 and 2


def measure_footer(file: BinaryIO, size: int) -> tuple[int, int]:
    """Return the bytes of a shard's footer and the memory that it may take; without one, raise ValueError."""
    if size < 12 or (tail := read_at(file, size - 8, 8))[4:] != _MARK:
        raise ValueError("no footer")
    length = int.from_bytes(tail[:4], "little")
    if length > size - 12:
        raise ValueError("the footer is longer than the file")
    return length, _FOOTER * length


def seal_footer(file: BinaryIO) -> None:
    """Write a seal before the footer of a complete file, which is open for reading too."""
    size = file.seek(0, os.SEEK_END)
    length = measure_footer(file, size)[0]
    start = size - _END - length
    rest = read_at(file, start, length + _END)
    file.seek(start)
    file.write(_SEAL + zlib.crc32(rest).to_bytes(4, "little") + rest)


def check_seal(file: BinaryIO, size: int, length: int) -> None:
    """Raise ValueError if a footer of `length` bytes is not the sealed one; older files have no seal."""
    start = size - _END - length
    before = read_at(file, start - len(_SEAL) - 4, len(_SEAL) + 4) if start >= len(_SEAL) + 4 else b""
    if before.startswith(_SEAL):
        checksum = zlib.crc32(read_at(file, start, length + _END))
        if checksum != int.from_bytes(before[len(_SEAL) :], "little"):
            raise ValueError("the footer's checksum is wrong")


def measure_pages(file: BinaryIO, metadata: Any, columns: list[int], objects: bool, left: int) -> int:
    """Return the memory that columns may take, bytes; raise ValueError for pages that strand does not write.

    Once it is more than `left`, no more is read.

    Parameters
    ----------
    file : binary file
    metadata : pyarrow.parquet.FileMetaData
    columns : list of int
        Numbers of the leaves to read.
    objects : bool
        Whether the rows become Python objects.
    left : int
        Bytes.
    """
    memory, end = 0, file.seek(0, os.SEEK_END)
    for number in range(metadata.num_row_groups):
        group = metadata.row_group(number)
        for place in columns:
            column = group.column(place)
            if column.has_dictionary_page:
                raise ValueError("a dictionary, which strand does not write")
            start, length = int(column.data_page_offset), int(column.total_compressed_size)
            if start < 0 or not 0 <= length <= end - start:
                raise ValueError("a column outside of the file")
            if memory + length > left:
                return memory + length
            pages, size, values = _sum_pages(read_at(file, start, length))
            if values != column.num_values or group.num_rows > values:
                raise ValueError(f"pages of {values} values, but {column.num_values} are declared")
            memory += _PAGE * pages + (_CONTENT + _TEXT * objects) * size
            memory += (_VALUE + _OBJECT * objects) * values
            if memory > left:
                return memory
    return memory


def _sum_pages(data: bytes) -> tuple[int, int, int]:
    """Return the number of a column's pages, their bytes, and the number of their values."""
    at = pages = size = values = 0
    while at < len(data):
        header, at = _read_struct(data, at, 0)
        page = header.get(5)
        if header.get(1) != _DATA_PAGE or not isinstance(page, dict) or page.get(2) not in _ENCODINGS:
            raise ValueError("a page of a kind that strand does not write")
        declared = [int(one) for one in (header.get(2, -1), header.get(3, -1), page.get(1, -1))]
        if min(declared) < 0:
            raise ValueError("a page without sizes")
        pages, size, values = pages + 1, size + max(declared[:2]), values + declared[2]
        at += declared[1]
    if at != len(data):
        raise ValueError("a page that ends outside of its column")
    return pages, size, values


def _read_struct(data: bytes, at: int, depth: int) -> tuple[dict[int, Any], int]:
    """Return the fields of a struct in Thrift's compact form that are numbers or structs, and its end."""
    if depth > _MAX_DEPTH:
        raise ValueError("a header that is too deep")
    fields: dict[int, Any] = {}
    field = 0
    while True:
        if at >= len(data):
            raise ValueError("a header that is cut off")
        head, at = data[at], at + 1
        if not head:
            return fields, at
        if head >> 4:
            field += head >> 4
        else:
            field, at = _read_number(data, at)
        kind = head & 15
        if kind in (1, 2):  # true and false
            fields[field] = kind == 1
        elif kind in (4, 5, 6):
            fields[field], at = _read_number(data, at)
        elif kind == 8:
            length, at = _read_varint(data, at)
            at += length
        elif kind == _STRUCT:
            fields[field], at = _read_struct(data, at, depth + 1)
        elif kind in _LENGTHS:
            at += _LENGTHS[kind]
        else:
            raise ValueError("a header with a field that no page has")


def _read_number(data: bytes, at: int) -> tuple[int, int]:
    """Return a signed number, and its end."""
    raw, at = _read_varint(data, at)
    return (raw >> 1) ^ -(raw & 1), at


def _read_varint(data: bytes, at: int) -> tuple[int, int]:
    """Return a number without a sign, and its end."""
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(data):
            break
        value |= (data[at] & 127) << shift
        at += 1
        if data[at - 1] < 128:
            return value, at
    raise ValueError("a number that is cut off")


def measure_rows(file: BinaryIO, metadata: Any, group: int, columns: list[int], rows: int) -> int:
    """Return the memory that so many rows of a foreign file take, bytes; its pages may be of any kind.

    Readers decompress whole pages. The pages of a column must have as many values as its footer declares.
    """
    memory = 0
    for place in columns:
        column = metadata.row_group(group).column(place)
        largest, whole, dictionary, values = _walk_pages(file, column)
        if values != column.num_values:
            raise ValueError(f"pages of {values} values, but {column.num_values} are declared")
        memory += _COPIES * largest + min(whole, rows * largest) + rows * dictionary
    return memory


def _walk_pages(file: BinaryIO, column: Any) -> tuple[int, int, int, int]:
    """Return the bytes of a column's largest page, of all pages and of the dictionary; and all values."""
    at = column.data_page_offset
    if column.has_dictionary_page and column.dictionary_page_offset:
        at = min(at, column.dictionary_page_offset)
    end = at + column.total_compressed_size
    largest = whole = dictionary = values = 0
    if at < 0 or not at <= end <= file.seek(0, os.SEEK_END):
        raise ValueError("a column outside of the file")
    while at < end:
        header, length = _read_struct(read_at(file, at, min(_HEADER, end - at)), 0, 0)
        unpacked, packed = (header.get(place, -1) for place in (2, 3))
        if not all(isinstance(one, int) and one >= 0 for one in (unpacked, packed)):
            raise ValueError("a page without sizes")
        details = header.get(_VALUE_PLACES.get(header.get(1, -1), -1))
        if isinstance(details, dict):
            count = details.get(1, -1)
            if not isinstance(count, int) or count < 0:
                raise ValueError("a page without a number of values")
            values += count
        size = max(unpacked, packed)
        if header.get(1) == _DICTIONARY:
            dictionary = size
        largest, whole, at = max(largest, size), whole + size, at + length + packed
    if at != end:
        raise ValueError("a page that ends outside of its column")
    return largest, whole, dictionary, values

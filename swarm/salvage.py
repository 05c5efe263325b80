"""What can be read of an MCAP file, whole, cut or damaged; pure, and bounded whatever the bytes.

    read_at --walk--> Record | Damage ... --chunk_parts--> Schema, Channel, Message

The mcap package stops at the first oddity of a file and trusts the sizes written in it. This
walker checks every length before it reads or unpacks, names what it has to skip, and goes on at
the next chunk: a record's frame is opcode (1), length (8), body; a chunk is found again by its
compression's name and two lengths that must agree (https://mcap.dev/spec).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from enum import IntEnum

import lz4.frame  # type: ignore[import-untyped]
import msgspec
import zstandard

MAGIC = b"\x89MCAP0\r\n"
RECORD_BYTES_MAX = (
    64 << 20
)  # 500 robots of 4096 beams make ticks of 16 MB; nothing of ours is larger
SEARCH_BYTES = 1 << 20  # read at a time while looking for the next chunk
FRAME = struct.Struct("<BQ")
FOOTER_BODY = struct.Struct("<QQI")
_MARKS = (b"\x03\x00\x00\x00lz4", b"\x04\x00\x00\x00zstd")
_BEFORE_MARK = FRAME.size + 28  # start, end, size (8 each) and crc (4) of a chunk

ReadAt = Callable[[int, int], bytes]  # (offset, size): at most size bytes


class Opcode(IntEnum):
    """First byte of a record."""

    HEADER = 1
    FOOTER = 2
    SCHEMA = 3
    CHANNEL = 4
    MESSAGE = 5
    CHUNK = 6
    MESSAGE_INDEX = 7
    CHUNK_INDEX = 8
    ATTACHMENT = 9
    ATTACHMENT_INDEX = 10
    STATISTICS = 11
    METADATA = 12
    METADATA_INDEX = 13
    SUMMARY_OFFSET = 14
    DATA_END = 15


class Record(msgspec.Struct, frozen=True):
    """One record of the file, its frame found plausible and its body unread."""

    opcode: int
    offset: int  # of the frame
    size: int  # with the frame
    body: bytes


class Damage(msgspec.Struct, frozen=True):
    """Bytes that could not be read; `cut` when the file just ends there."""

    offset: int
    size: int
    text: str
    cut: bool = False
    crc: bool = False  # all of it is there, but a byte has changed


class CrcError(ValueError):
    """What is there does not fit its checksum, or cannot be unpacked."""


class Schema(msgspec.Struct, frozen=True):
    """Schema record: `id` is what channels refer to, 0 is none."""

    id: int
    name: str
    encoding: str
    data: bytes


class Channel(msgspec.Struct, frozen=True):
    """Channel record."""

    id: int
    schema_id: int
    topic: str
    message_encoding: str
    metadata: Mapping[str, str]


class Message(msgspec.Struct, frozen=True):
    """Message record."""

    channel_id: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: bytes


def walk(read_at: ReadAt, size: int) -> Iterator[Record | Damage]:
    """Records of a file of `size` bytes in order, and what lies between them that is none.

    Ends with the footer of a whole file, else with a Damage that has `cut`. Linear in the size.
    """
    offset = len(MAGIC)
    if read_at(0, offset) != MAGIC:
        offset = _next_chunk(read_at, 0, size)
        yield Damage(0, offset, "the file does not begin with the MCAP magic", cut=offset == size)
        if offset == size:
            return
    while offset < size:
        record, oddity = _record(read_at, offset, size)
        if record is None:
            end = _next_chunk(read_at, offset + 1, size)
            yield Damage(offset, end - offset, oddity, cut=end == size)
            if end == size:
                return
            offset = end
            continue
        offset += record.size
        yield record
        if record.opcode == Opcode.FOOTER:
            if read_at(offset, len(MAGIC) + 1) != MAGIC:
                yield Damage(offset, size - offset, "the closing magic is missing or not the end")
            return
    yield Damage(size, 0, "the file ends without a footer", cut=True)


def _record(read_at: ReadAt, offset: int, size: int) -> tuple[Record | None, str]:
    frame = read_at(offset, FRAME.size)
    if len(frame) < FRAME.size:
        return None, "the file ends within a record"
    opcode, length = FRAME.unpack(frame)
    end = offset + FRAME.size + length
    if not (1 <= opcode <= Opcode.DATA_END or opcode >= 0x80):  # from 0x80 they are private
        return None, f"unknown record 0x{opcode:02x}"
    if opcode == Opcode.FOOTER and length != FOOTER_BODY.size:
        return None, f"a footer of {length} bytes"
    if length > RECORD_BYTES_MAX:
        return None, f"a record of {length} bytes, more than {RECORD_BYTES_MAX}"
    if end > size:
        return None, "the file ends within a record"
    return Record(opcode, offset, FRAME.size + length, read_at(offset + FRAME.size, length)), ""


def _next_chunk(read_at: ReadAt, start: int, size: int) -> int:
    """Offset of the first plausible chunk from `start` on; `size` when there is none."""
    at = start
    while at < size:
        block = read_at(at, SEARCH_BYTES)
        if len(block) < _BEFORE_MARK:
            return size
        found = -1
        for mark in _MARKS:
            position = block.find(mark, _BEFORE_MARK)
            while position >= 0 and (found < 0 or position < found):
                begin = position - _BEFORE_MARK
                if block[begin] == Opcode.CHUNK and _is_chunk(read_at, at + begin, len(mark), size):
                    found = position
                position = block.find(mark, position + 1)
        if found >= 0:
            return at + found - _BEFORE_MARK
        at += max(1, len(block) - _BEFORE_MARK - max(map(len, _MARKS)))  # a mark may straddle two
        if len(block) < SEARCH_BYTES:
            return size
    return size


def _is_chunk(read_at: ReadAt, offset: int, mark_bytes: int, size: int) -> bool:
    opcode, length = FRAME.unpack(read_at(offset, FRAME.size))
    data_at = _BEFORE_MARK + mark_bytes
    field = read_at(offset + data_at, 8)
    inside = length + FRAME.size - data_at - 8
    return (
        opcode == Opcode.CHUNK
        and length <= RECORD_BYTES_MAX
        and offset + FRAME.size + length <= size
        and len(field) == 8
        and struct.unpack("<Q", field)[0] == inside
    )


# --- bodies ---------------------------------------------------------------------------------------


class _Fields:
    """Reads a body front to back; ValueError where it would pass the end."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def take(self, count: int) -> bytes:
        end = self.at + count
        if end > len(self.data):
            raise ValueError(f"expected {count} bytes at {self.at}, got {len(self.data) - self.at}")
        piece = self.data[self.at : end]
        self.at = end
        return piece

    def number(self, layout: str) -> int:
        value: int = struct.unpack(layout, self.take(struct.calcsize(layout)))[0]
        return value

    def text(self) -> str:
        return self.take(self.number("<I")).decode()  # UnicodeDecodeError is a ValueError

    def table(self) -> dict[str, str]:
        end = self.number("<I") + self.at
        result: dict[str, str] = {}
        while self.at < end:
            name = self.text()
            result[name] = self.text()
        return result


def header_profile(body: bytes) -> str:
    """Profile named in the header; raises ValueError."""
    return _Fields(body).text()


def metadata(body: bytes) -> tuple[str, dict[str, str]]:
    """Name and content of a metadata record; raises ValueError."""
    fields = _Fields(body)
    return fields.text(), fields.table()


def attachment(body: bytes) -> tuple[str, str, bytes]:
    """Name, media type and content of an attachment; raises ValueError or CrcError."""
    fields = _Fields(body)
    fields.take(16)  # log time, create time
    name, media_type = fields.text(), fields.text()
    data = fields.take(fields.number("<Q"))
    crc = zlib.crc32(body[: fields.at])
    if fields.number("<I") not in (0, crc):
        raise CrcError(f"attachment '{name[:80]}': its crc does not fit its content")
    return name, media_type, data


def chunk_parts(body: bytes) -> Iterator[Schema | Channel | Message]:
    """Content of a chunk whose crc fits, all of it checked before the first part is given.

    Raises:
        ValueError: it is longer than it tells, or than RECORD_BYTES_MAX.
        CrcError: a byte has changed.
    """
    fields = _Fields(body)
    fields.take(16)  # start and end time
    size, crc, compression = fields.number("<Q"), fields.number("<I"), fields.text()
    data = _unpack(compression, fields.take(fields.number("<Q")), size)
    if len(data) != size or (crc != 0 and zlib.crc32(data) != crc):
        raise CrcError("a chunk's crc does not fit its content")
    inner = _Fields(data)
    parts: list[Schema | Channel | Message] = []
    while inner.at < size:
        opcode, length = FRAME.unpack(inner.take(FRAME.size))
        part = record_part(opcode, inner.take(length))
        if part is not None:
            parts.append(part)
    yield from parts


def record_part(opcode: int, body: bytes) -> Schema | Channel | Message | None:
    """Schema, channel or message of a record; None for any other. Raises ValueError."""
    fields = _Fields(body)
    if opcode == Opcode.MESSAGE:
        if len(body) < 22:
            raise ValueError(f"expected a message of at least 22 bytes, got {len(body)}")
        channel_id, sequence, log_time_ns, publish_time_ns = struct.unpack_from("<HIQQ", body)
        return Message(channel_id, sequence, log_time_ns, publish_time_ns, body[22:])
    if opcode == Opcode.CHANNEL:
        numbers = fields.number("<H"), fields.number("<H")
        return Channel(*numbers, fields.text(), fields.text(), fields.table())
    if opcode == Opcode.SCHEMA:
        number = fields.number("<H")
        return Schema(number, fields.text(), fields.text(), fields.take(fields.number("<I")))
    return None


def _unpack(compression: str, data: bytes, size: int) -> bytes:
    if size > RECORD_BYTES_MAX:
        raise ValueError(f"a chunk of {size} bytes, more than {RECORD_BYTES_MAX}")
    try:
        if compression == "lz4":
            # Not lz4.frame.decompress: it would believe any size.
            decompressor = lz4.frame.LZ4FrameDecompressor()
            unpacked: bytes = decompressor.decompress(data, max_length=size)
            if not decompressor.eof:
                raise ValueError(f"a chunk larger than the {size} bytes that it tells")
            return unpacked
        if compression == "zstd":
            if zstandard.frame_content_size(data) > RECORD_BYTES_MAX:
                raise ValueError("a chunk larger than it may be")
            return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
    except (RuntimeError, zstandard.ZstdError, MemoryError) as error:
        raise CrcError(f"a chunk that cannot be unpacked: {error}") from error
    if compression:
        raise ValueError(f"a chunk compressed with '{compression[:20]}', expected lz4 or zstd")
    return data

"""ELF files made byte by byte, so that each can have the one property a test is about."""

import struct
from dataclasses import dataclass, replace

EXECUTABLE, NOBITS, ALLOC, WRITE, EXEC = 2, 8, 2, 1, 4
FUNC, OBJECT, NOTYPE = 2, 1, 0


@dataclass(frozen=True)
class Part:
    """A section, and a segment of its own unless `segment` is False."""

    name: str
    run: int  # where the program expects it
    content: bytes = b""
    load: int | None = None  # where it is loaded, if elsewhere
    room: int | None = None  # in memory, if more than the content
    flags: int = ALLOC | EXEC
    kind: int = 1
    segment: bool = True


@dataclass(frozen=True)
class Symbol:
    name: str
    value: int
    kind: int = FUNC
    bind: int = 1
    section: int = 1


def attributes(tags: dict[int, int | str]) -> Part:
    """.ARM.attributes of the whole file with these tags, all below 128."""
    pairs = b"".join(
        bytes((tag,)) + (value.encode() + b"\0" if isinstance(value, str) else bytes((value,)))
        for tag, value in tags.items()
    )
    inner = b"\x01" + struct.pack("<I", len(pairs) + 5) + pairs
    vendor = b"aeabi\0" + inner
    content = b"A" + struct.pack("<I", len(vendor) + 4) + vendor
    return Part(".ARM.attributes", 0, content, flags=0, kind=0x70000003, segment=False)


CORTEX_M4 = attributes({5: "Cortex-M4", 6: 13, 7: ord("M"), 9: 2, 10: 6, 27: 1})


def elf(
    *parts: Part,
    symbols: tuple[Symbol, ...] = (),
    kind: int = EXECUTABLE,
    with_sections: bool = True,
    headers_in_first: bool = False,
) -> bytes:
    """The file: headers, contents, section headers last, as linkers write it."""
    segments = [part for part in parts if part.segment]
    at = 52 + 32 * len(segments)
    body = bytearray()
    places = []
    for part in parts:
        body.extend(bytes(-(at + len(body)) % 4))
        places.append(at + len(body))
        body.extend(b"" if part.kind == NOBITS else part.content)
    table = b"".join(
        struct.pack(
            "<8I", 1, offset, part.run, part.run if part.load is None else part.load, size, room, 7, 4
        )
        for part, offset in zip(parts, places, strict=True)
        if part.segment
        for size in (0 if part.kind == NOBITS else len(part.content),)
        for room in (max(size, part.room or 0),)
    )
    if headers_in_first:
        _, offset, run, load, size, room, *rest = struct.unpack_from("<8I", table)
        first = struct.pack("<8I", 1, 0, run - offset, load - offset, size + offset, room + offset, *rest)
        table = first + table[32:]
    if not with_sections:
        return _header(kind, len(segments), 0, 0) + table + bytes(body)

    names, strings, entries = b"\0", b"\0", bytes(16)
    for symbol in symbols:
        entries += struct.pack(
            "<IIIBBH", len(strings), symbol.value, 0, symbol.bind << 4 | symbol.kind, 0, symbol.section
        )
        strings += symbol.name.encode() + b"\0"
    rows = [bytes(40)]
    for part, offset in zip(parts, places, strict=True):
        size = part.room if part.kind == NOBITS and part.room else len(part.content)
        rows.append(
            struct.pack("<10I", len(names), part.kind, part.flags, part.run, offset, size, 0, 0, 4, 0)
        )
        names += part.name.encode() + b"\0"
    count = len(parts) + (4 if symbols else 2)
    if symbols:
        for kind_of, content, link, entry in ((2, entries, count - 2, 16), (3, strings, 0, 0)):
            rows.append(
                struct.pack("<10I", 0, kind_of, 0, 0, at + len(body), len(content), link, 0, 1, entry)
            )
            body.extend(content)
    rows.append(struct.pack("<10I", 0, 3, 0, 0, at + len(body), len(names), 0, 0, 1, 0))
    body.extend(names)
    return _header(kind, len(segments), at + len(body), count) + table + bytes(body) + b"".join(rows)


def _header(kind: int, segments: int, sections_at: int, sections: int) -> bytes:
    ident = b"\x7fELF\x01\x01\x01".ljust(16, b"\0")
    return struct.pack(
        "<16sHHIIIIIHHHHHH",
        *(ident, kind, 40, 1, 0, 52 if segments else 0, sections_at, 0x05000200, 52, 32, segments, 40),
        *(sections, max(sections - 1, 0)),
    )


def with_load(part: Part, load: int) -> Part:
    """The same part loaded elsewhere than it runs."""
    return replace(part, load=load)


def vectors(stack: int = 0x2001C000, reset: int = 0x08000009) -> bytes:
    """The two words every firmware begins with."""
    return struct.pack("<II", stack, reset)

"""MDF4 files for tests: measured ones by asammdf, one by hand that it would not write."""

import struct

import numpy as np

T = np.arange(20) / 100


def signal(name, values=None, unit="mm", t_s=T, **more):
    values = np.arange(len(t_s), dtype=np.float64) if values is None else np.asarray(values)
    from asammdf import Signal

    return Signal(samples=values, timestamps=t_s, name=name, unit=unit, **more)


def mf4(tmp_path, *groups, compression=0):
    """A file of groups, each a list of signals on one time base."""
    from asammdf import MDF

    path = tmp_path / "ride.mf4"
    with MDF(version="4.10") as mdf:
        for group in groups:
            mdf.append(group, common_timebase=True)
        mdf.save(path, overwrite=True, compression=compression)
    return path


def block(path, name):
    """Where the first block of that name begins."""
    return path.read_bytes().index(b"##" + name)


def patched(path, at, layout, *values):
    content = bytearray(path.read_bytes())
    struct.pack_into(layout, content, at, *values)
    path.write_bytes(content)
    return path


def unsorted(path):
    """A file whose two groups, of 10 and of 5 records, take turns in one data block."""
    parts, end = [], 64

    def add(name, links, body):
        nonlocal end
        at = end
        raw = struct.pack("<4s4xQQ", b"##" + name, 24 + 8 * len(links) + len(body), len(links))
        raw += struct.pack(f"<{len(links)}Q", *links) + body
        parts.append(raw + bytes(-len(raw) % 8))
        end += len(parts[-1])
        return at

    def channel(name, kind, sync, byte, after=0):
        text = add(b"TX", [], name.encode() + b"\0")
        body = struct.pack("<4B4I", kind, sync, 4, 0, byte, 64, 0, 0) + bytes(52)
        return add(b"CN", [after, 0, text, 0, 0, 0, 0, 0], body)

    def group(name, identifier, records, after=0):
        time = channel("time", 2, 1, 0, channel(name, 0, 0, 8))
        return add(b"CG", [after, time, 0, 0, 0, 0], struct.pack("<QQ8xII", identifier, records, 16, 0))

    add(b"HD", [0] * 6, bytes(32))
    groups = group("fork_stroke_mm", 1, 10, group("rear_stroke_mm", 2, 5))
    records = b"".join(
        struct.pack("<Bdd", 1, k / 100, k) + (struct.pack("<Bdd", 2, k / 100, -k) if k % 2 else b"")
        for k in range(10)
    )
    data = add(b"DG", [0, groups, add(b"DT", [], records), 0], struct.pack("<B7x", 1))
    content = bytearray(b"".join(parts))
    struct.pack_into("<Q", content, 24, data)
    path.write_bytes(struct.pack("<8s8s8s4xH34x", b"MDF     ", b"4.10    ", b"test    ", 410) + content)
    return path

"""DataFlash records: found, checked, and their fields taken out, many at once.

A log is records of 0xA3 0x95, a type and the type's fields, packed and little-endian. Type 128, FMT, defines
the others: number, length, name, a letter for each field, their labels. There are no checksums. A record
counts if its type is defined and another record or the end of the file follows it; an FMT counts if its
letters add up to its length, and the first one for a number holds.

Belongs here: framing and definitions. Never: what a type or a field means.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.errors import LapError
from bench.laps.mavlink.messages import between, content, listed
from targets.jit import njit

FMT = 128
TYPES: dict[str, np.dtype] = {
    letter: np.dtype(kind)
    for letters, kind in (
        ("a", ("<i2", 32)),
        ("b", "i1"),
        ("BM", "u1"),
        ("hc", "<i2"),
        ("HC", "<u2"),
        ("ieL", "<i4"),
        ("IE", "<u4"),
        ("q", "<i8"),
        ("Q", "<u8"),
        ("g", "<f2"),
        ("f", "<f4"),
        ("d", "<f8"),
        ("n", "S4"),
        ("N", "S16"),
        ("Z", "S64"),
    )
    for letter in letters
}
"""Letter of a field's type -> how it is stored."""
_SIZES = np.zeros(256, dtype=np.int64)
for _letter, _type in TYPES.items():
    _SIZES[ord(_letter)] = _type.itemsize
_DEFINITION = np.dtype(
    [("head", "V3"), ("kind", "u1"), ("length", "u1"), ("name", "S4"), ("letters", "S16"), ("labels", "S64")]
)


@dataclass(frozen=True)
class Definition:
    """One type of record: its number, and for each field a letter and a label."""

    kind: int
    name: str
    letters: str
    labels: tuple[str, ...]

    def letter(self, label: str) -> str:
        """The letter of the field `label`."""
        return self.letters[self.labels.index(label)]

    def offset(self, label: str) -> int:
        """Bytes from a record's start to the field `label`."""
        return 3 + sum(TYPES[letter].itemsize for letter in self.letters[: self.labels.index(label)])

    def layout(self) -> np.dtype:
        """A record as a structured dtype, its first three bytes under the name `head`."""
        fields = zip(self.labels, (TYPES[letter] for letter in self.letters), strict=True)
        return np.dtype([("head", "V3"), *fields])


class Log:
    """The records of one file. `named`: definitions by name; `damage`: what was skipped, one line each."""

    def __init__(self, path: Path) -> None:
        self.path, self.data = path, content(path)
        starts, lengths = _find(self.data, _SIZES)
        if not len(starts):
            raise LapError(f"{path}: no DataFlash record in its {len(self.data)} bytes")
        self.starts, self.kinds = starts, self.data[starts + 2]
        self.damage = list(between(starts, starts + lengths[self.kinds], len(self.data)))
        self.named: dict[str, Definition] = {}
        self._define()

    def count(self, kind: Definition) -> int:
        """How many records of a type there are."""
        return int(np.count_nonzero(self.kinds == kind.kind))

    def present(self) -> str:
        """The types of which there are records, as text."""
        return listed(name for name, kind in self.named.items() if self.count(kind)) or "nothing"

    def field(self, kind: Definition, label: str) -> NDArray:
        """One field of all records of a type, (records,) or for the letter a (records, 32)."""
        form = TYPES[kind.letter(label)]
        at = self.starts[self.kinds == kind.kind] + kind.offset(label)
        cells = np.empty((len(at), form.itemsize), dtype=np.uint8)
        for byte in range(form.itemsize):
            cells[:, byte] = self.data[at + byte]
        return cells.view(form.base).reshape(len(at), *form.shape)

    def _define(self) -> None:
        first: dict[int, bytes] = {}
        for at in self.starts[self.kinds == FMT].tolist():
            record = self.data[at : at + _DEFINITION.itemsize].tobytes()
            row = np.frombuffer(record, _DEFINITION)[0]
            kind, name = int(row["kind"]), row["name"].decode("latin-1")
            letters = row["letters"].decode("latin-1")
            labels = tuple(row["labels"].decode("latin-1").split(",")) if row["labels"] else ()
            if kind in first:
                if first[kind] != record:
                    self.damage.append(
                        f"byte {at}: type {kind} is defined again, as {name!r}; the first holds"
                    )
                continue
            first[kind] = record
            if len(labels) != len(letters) or len(set(labels)) != len(labels) or name in self.named:
                self.damage.append(
                    f"byte {at}: the definition of type {kind}, {name!r}, is damaged; its records are skipped"
                )
                continue
            self.named[name] = Definition(kind, name, letters, labels)


def definition_record(definition: Definition) -> bytes:
    """The FMT record that defines a type."""
    row = np.zeros(1, _DEFINITION)
    row["head"], row["kind"] = head(FMT), definition.kind
    row["length"] = definition.layout().itemsize
    row["name"], row["letters"] = definition.name.encode(), definition.letters.encode()
    row["labels"] = ",".join(definition.labels).encode()
    return row.tobytes()


def head(kind: int) -> bytes:
    """The first three bytes of a record."""
    return bytes((0xA3, 0x95, kind))


@njit(cache=True)
def _find(data: Any, sizes: Any) -> Any:
    """Where records start, and the length of each type's."""
    size = len(data)
    starts = np.empty(size // 3 + 1, np.int64)  # a type may have no fields
    lengths = np.zeros(256, np.int64)
    lengths[128] = 89
    count = 0
    at = 0
    while at + 3 <= size:
        length: Any = 0
        if data[at] == 0xA3 and data[at + 1] == 0x95:
            length = lengths[data[at + 2]]
        after = at + length
        good: Any = length > 0 and after <= size
        if good and data[at + 2] == 128:
            kind: Any = data[at + 3]
            total: Any = 3
            for k in range(16):
                letter: Any = data[at + 9 + k]
                if letter == 0:
                    break
                # a letter that is none makes the sum wrong for good
                total += sizes[letter] if sizes[letter] > 0 else 1000
            good = total == data[at + 4] and (lengths[kind] == 0 or lengths[kind] == total)
            if good:
                lengths[kind] = total
        elif good:
            good = (after >= size or data[after] == 0xA3) and (after + 1 >= size or data[after + 1] == 0x95)
        if good:
            starts[count] = at
            count += 1
            at = after
        else:
            at += 1
    return starts[:count].copy(), lengths

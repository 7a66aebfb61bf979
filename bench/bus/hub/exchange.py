"""The hub without its sockets: bytes of members in, bytes for members out, one order for all of them.

Belongs here: who hears what, and who has to wait. Never: a socket, a clock.

Rules: a frame that has been taken reaches every other member, in the order in which frames were taken, with
one time. A member whose queue is full holds the exchange up: no more frames are taken of anybody until half
of it has gone. One that has read nothing for the exchange's patience while it did so is put off the bus.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

from bench.bus.hub import wire

if TYPE_CHECKING:
    from bench.bus.hub.paced import Paced

QUEUE_BYTES = 1 << 20
"""A member's queue: 43,690 classic frames of 8 bytes, five seconds of a full bus at 1 Mbit/s."""


class Member:
    """A client as the exchange sees it. name: in notices. own: whether it hears what it sends.

    out: what waits for it. hears: whether more will come. expelled: it has been put off the bus. full_ns:
    since when the queue has been full and nothing of it has gone; None: it is not full.
    """

    def __init__(self, name: str, own: bool) -> None:
        self.name = name
        self.own = own
        self.out = bytearray()
        self.rest = bytearray()  # of what it sent, a record's beginning
        self.hears = True
        self.expelled = False
        self.full_ns: int | None = None


class Exchange:
    """Members and what goes between them. paced: the bus that the frames go over.

    told: how often the members have been told who holds them up, or that nobody does any more.
    clock: ns since 1970. epoch: the same at instant 0 of the caller's own clock, for what `paced` carries.
    """

    def __init__(
        self,
        clock: Callable[[], int],
        patience_ns: int,
        paced: "Paced | None" = None,
        epoch: Callable[[], int] = lambda: 0,
        queue_bytes: int = QUEUE_BYTES,
    ) -> None:
        self._clock = clock
        self._patience_ns = patience_ns
        self._paced = paced
        self._epoch = epoch
        self._queue_bytes = queue_bytes
        self._full: list[Member] = []
        self.members: list[Member] = []
        self.told = 0

    @property
    def held_up(self) -> bool:
        """Whether frames have to wait, for at least one member's queue is full."""
        return bool(self._full)

    def takes_from(self, member: Member) -> bool:
        """Whether `member` may send: nobody holds the exchange up, and a timed bus has room for it."""
        return not (self._full or member.expelled) and (self._paced is None or self._paced.has_room(member))

    def join(self, name: str, own: bool) -> Member:
        """Add a member; it hears what is taken from now on."""
        member = Member(name, own)
        self.members.append(member)
        return member

    def leave(self, member: Member) -> None:
        """Forget a member; what it has sent still goes to the others."""
        self.members.remove(member)
        self._relieve(member)

    def deafen(self, member: Member) -> None:
        """It hears no more, and its queue goes nowhere; what it has sent is still taken."""
        member.hears = False
        member.out.clear()
        self._relieve(member)

    def take(self, member: Member, data: bytes, now_ns: int) -> None:
        """Take what `member` has sent; a record's missing end may follow. WireError at what is none."""
        member.rest += data
        while member.rest and (end := wire.stamp(member.rest, self._clock)):
            batch = member.rest[:end]
            del member.rest[:end]
            passed = [batch] if self._paced is None else self._paced.put(member, batch, now_ns)
            for part in passed:
                self._spread(member, part, now_ns)

    def run(self, now_ns: int) -> None:
        """Spread what a timed bus has carried up to `now_ns`; put off the bus who has exhausted patience."""
        if self._paced is not None:
            for sender, ended_ns, frame in self._paced.run(now_ns):
                wire.set_time(frame, self._epoch() + ended_ns)
                self._spread(sender, frame, now_ns)
        for member in tuple(self._full):
            if member.full_ns is not None and now_ns - member.full_ns >= self._patience_ns:
                self._expel(member)

    def due_ns(self) -> int | None:
        """When `run` next has something to do, if nothing comes in; None: never."""
        dues = [member.full_ns + self._patience_ns for member in self._full if member.full_ns is not None]
        carried_ns = self._paced.due_ns() if self._paced else None
        return min(dues if carried_ns is None else [*dues, carried_ns], default=None)

    def went(self, member: Member, count: int, now_ns: int) -> None:
        """`count` bytes of the member's queue have reached it."""
        del member.out[:count]
        if member.full_ns is not None and count:
            if 2 * len(member.out) > self._queue_bytes:
                member.full_ns = now_ns
            else:
                self._relieve(member)

    def _spread(self, sender: Member, batch: bytes | bytearray, now_ns: int) -> None:
        for member in self.members:
            if not member.hears or (member is sender and not member.own):
                continue
            member.out += batch if member is not sender else wire.own(batch)
            if len(member.out) > self._queue_bytes and member.full_ns is None:
                member.full_ns = now_ns
                self._full.append(member)
                self._tell(member.name)

    def _tell(self, name: str) -> None:
        self.told += 1
        said = wire.notice(wire.HELD_UP, name)
        for member in self.members:
            if member.hears:
                member.out += said

    def _expel(self, member: Member) -> None:
        member.out += wire.notice(
            wire.REFUSED,
            f"{member.name} read nothing for {self._patience_ns / 1e9:g} s "
            f"while {len(member.out)} bytes waited for it, and is off the bus",
        )
        member.hears, member.expelled = False, True
        self._relieve(member)

    def _relieve(self, member: Member) -> None:
        if member in self._full:
            self._full.remove(member)
            member.full_ns = None
            self._tell(self._full[0].name if self._full else "")

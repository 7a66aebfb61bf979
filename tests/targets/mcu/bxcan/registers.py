"""A bxCAN to poke: registers by offset, time by hand, and a bus that says what the test wants it to."""

from targets.mcu import bxcan, rcc
from targets.mcu.bxcan import node
from targets.mcu.state import CAN_BITRATE, CAN_STRIDE, CYCLES, HZ, allocate

MCR, MSR, TSR, RF0R, RF1R, IER, ESR, BTR = 0x00, 0x04, 0x08, 0x0C, 0x10, 0x14, 0x18, 0x1C
TIR, TDTR, TDLR, TDHR = (0x180 + 4 * k for k in range(4))
RIR, RDTR, RDLR, RDHR = (0x1B0 + 4 * k for k in range(4))
MAILBOX = FIFO = 0x10  # from one to the next
FMR, FM1R, FS1R, FFA1R, FA1R, F0R1 = 0x200, 0x204, 0x20C, 0x214, 0x21C, 0x240

RATE, BIT = 500_000, 2_000
BTR_500K = 1 | 15 << 16 | 4 << 20  # of 22 MHz: 2 * (1 + 16 + 5)
INRQ, SLEEP, TXFP, RFLM, NART, AWUM, ABOM, TTCM = (1 << k for k in range(8))
INAK, SLAK, ERRI, WKUI, SLAKI = (1 << k for k in range(5))
STUFF, FORM, ACK, RECESSIVE, DOMINANT, CRC = range(1, 7)
US = 1_000


class Can:
    """CAN1, or CAN2 with `number` 2, at 22 MHz on a bus of 500 kbit/s, as reset leaves it."""

    def __init__(self, number=1, S=None):
        self.S = allocate() if S is None else S
        self.c = CAN_STRIDE * (number - 1)
        self._base = 0x400 * (number - 1)
        if S is None:
            self.S[HZ] = 22_000_000
            rcc.reset(self.S)
            bxcan.reset(self.S)
        self.S[CAN_BITRATE + self.c] = RATE
        self.irq = 19 if number == 1 else 63

    def __getitem__(self, offset):
        return bxcan.read(self.S, self._base + offset)

    def __setitem__(self, offset, value):
        assert bxcan.write(self.S, self._base + offset, value)

    @property
    def t_ns(self):
        return int(self.S[CYCLES]) * 1000 // 22

    @t_ns.setter
    def t_ns(self, t_ns):
        self.S[CYCLES] = -(-t_ns * 22 // 1000)
        bxcan.service(self.S)

    def configured(self, btr=BTR_500K, mcr=0):
        """In normal mode with this bit timing and these bits of MCR."""
        self[MCR] = INRQ
        self[BTR] = btr
        self[MCR] = mcr
        self.t_ns += 10**6
        assert self[MSR] & (INAK | SLAK) == 0
        return self

    def open_filter(self, fifo=0, bank=0):
        """A 32-bit mask filter that lets every frame in; to be called for CAN1, whose registers they are."""
        self[FMR] = 14 << 8 | 1
        self[FS1R] |= 1 << bank
        self[FFA1R] = self[FFA1R] & ~(1 << bank) | fifo << bank
        self[FA1R] |= 1 << bank
        self[FMR] = 14 << 8
        return self

    def fill(self, mailbox, identifier, data=b"", extended=False, remote=False, more=0):
        """Put a frame into a mailbox and request it; more: other bits of TDTR."""
        word = int.from_bytes(data.ljust(8, b"\0"), "little")
        self[TDTR + MAILBOX * mailbox] = len(data) | more
        self[TDLR + MAILBOX * mailbox] = word & 0xFFFFFFFF
        self[TDHR + MAILBOX * mailbox] = word >> 32
        self[TIR + MAILBOX * mailbox] = rir(identifier, extended, remote) | 1

    # What the bus says; without an instant: now.

    def starts(self, mailbox=None, t_ns=None):
        node.started(self.S, self.c, self.t_ns if t_ns is None else t_ns, -1 if mailbox is None else mailbox)

    def arrives(self, identifier, data=b"", t_ns=None, extended=False, remote=False):
        head = rir(identifier, extended, remote) | len(data) << 32
        word = int.from_bytes(data.ljust(8, b"\0"), "little", signed=True)
        return node.receive(self.S, self.c, self.t_ns if t_ns is None else t_ns, head, word)

    def is_sent(self, mailbox, t_ns=None):
        node.sent(self.S, self.c, self.t_ns if t_ns is None else t_ns, mailbox)

    def errs(self, mailbox=None, code=FORM, tec=0, rec=0, t_ns=None):
        t_ns = self.t_ns if t_ns is None else t_ns
        node.error(self.S, self.c, t_ns, -1 if mailbox is None else mailbox, code, tec, rec)

    def is_free(self, t_ns=None):
        node.ended(self.S, self.c, self.t_ns if t_ns is None else t_ns)

    def fails(self, mailbox=None, code=FORM, tec=0, rec=0):
        """A frame starts and fails at once; an error frame of 14 bits follows."""
        self.starts(mailbox)
        self.errs(mailbox, code, tec, rec)
        self.t_ns += 14 * BIT
        self.is_free()

    def passes(self, mailbox=None):
        """A frame goes well: its own of `mailbox`, or another's."""
        self.starts(mailbox)
        self.t_ns += 100 * BIT
        if mailbox is None:
            self.arrives(0x7FF)
        else:
            self.is_sent(mailbox)

    def offers(self):
        return node.offer(self.S, self.c, self.t_ns)

    def line(self, which):
        """Level of interrupt line 0 TX, 1 RX0, 2 RX1, 3 SCE."""
        return bxcan.line(self.S, self.irq + which)

    @property
    def tec(self):
        return self[ESR] >> 16 & 0xFF

    @property
    def rec(self):
        return self[ESR] >> 24

    @property
    def lec(self):
        return self[ESR] >> 4 & 7


def rir(identifier, extended=False, remote=False):
    """An identifier register: TIxR without TXRQ, RIxR, or a 32-bit filter."""
    return (identifier << 3 | 4 if extended else identifier << 21) | (2 if remote else 0)

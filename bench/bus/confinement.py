"""Error counters of a node and what follows: error passive, bus-off, recovery (ISO 11898-1 clause 12.1.4).

Belongs here: the counters. Never: how much an error adds (wire), who sends when (timed).
"""

from targets.ecu import Confinement, SeenError

PASSIVE, BUS_OFF = 128, 256
"""A counter that reaches the first makes a node error passive; a transmit counter the second, bus-off."""

RECESSIVE_BITS, SEQUENCES = 11, 128
"""Bus-off ends after so many sequences of so many recessive bits."""

_REC_MAX = 255
_REC_AFTER = 120  # after a reception from beyond PASSIVE; the standard allows 119 to 127


class ErrorCounters:
    """Transmit and receive error counter, `tec` and `rec`, of one node, error active to begin with."""

    def __init__(self) -> None:
        self.tec = 0
        self.rec = 0
        self.left = 0  # sequences of recessive bits until the end of bus-off

    @property
    def confinement(self) -> Confinement:
        """ACTIVE, PASSIVE, or OFF for bus-off."""
        if self.left:
            return Confinement.OFF
        return Confinement.PASSIVE if max(self.tec, self.rec) >= PASSIVE else Confinement.ACTIVE

    def transmitted(self) -> None:
        """A frame was sent without error."""
        self.tec = max(self.tec - 1, 0)

    def received(self) -> None:
        """A frame was received without error."""
        self.rec = _REC_AFTER if self.rec > PASSIVE else max(self.rec - 1, 0)

    def error(self, error: SeenError) -> None:
        """The node saw an error."""
        self.tec += error.tec
        self.rec = min(self.rec + error.rec, _REC_MAX)
        if self.tec >= BUS_OFF:
            self.left = SEQUENCES

    def recessive(self, bits: int) -> None:
        """In bus-off: the bus was recessive for `bits` bits, as long as it stayed so."""
        self.left = max(self.left - bits // RECESSIVE_BITS, 0)
        if not self.left:
            self.tec = self.rec = 0

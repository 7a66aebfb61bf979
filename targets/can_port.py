"""One bxCAN of an emulated MCU as a node on a bus: frames to registers and back. Never: what registers do."""

from typing import NoReturn

from targets.ecu import Confinement, Frame, SeenError, Transmission
from targets.errors import FirmwareFault
from targets.mcu import state
from targets.mcu.bxcan import course, mailboxes, node, timing
from targets.mcu.bxcan.registers import IDE, MAILBOXES, RTR, TGT
from targets.mcu.machine import Stm32f405

_BITS_A_CONTROLLER = 8  # of CAN_TX_NEW
_MOST_BYTES = 8


class CanPort:
    """bxCAN `controller`, 1 or 2, of `mcu`, wired to a bus of `bitrate` bit/s; a `targets.ecu.Controller`.

    Whoever runs the machine collects what it asks to send (`collect`). A controller without a port is on no
    bus: its requests stay pending. Two buses on one machine are served in time if the machine is run in steps
    no longer than the shortest frame.
    """

    def __init__(self, mcu: Stm32f405, controller: int = 1, bitrate: int = 500_000) -> None:
        if controller not in (1, 2):
            raise ValueError(f"an STM32F405 has CAN1 and CAN2, no CAN{controller}")
        self.mcu = mcu
        self.controller = controller
        self._c = (controller - 1) * state.CAN_STRIDE
        self._shift = (controller - 1) * _BITS_A_CONTROLLER
        # The same array, whose words a memoryview reads at a third of the cost.
        self._words = memoryview(mcu.state.data)
        self._words[state.CAN_BITRATE + self._c] = bitrate
        self._waiting: list[Transmission] = []
        # By mailbox: its last request as numbered by the controller, and what it asks to send.
        self._known: list[tuple[int, Transmission] | None] = [None] * MAILBOXES

    def collect(self) -> None:
        """Take over the requests that the machine has made since the last time.

        Raises FirmwareFault if the bit rates differ, or if a request has waited in a bus-off without end.
        """
        news = self._words[state.CAN_TX_NEW]
        fresh = news >> self._shift & (1 << _BITS_A_CONTROLLER) - 1
        if not fresh:
            return
        self._words[state.CAN_TX_NEW] = news & ~(fresh << self._shift)
        if fresh & course.STUCK:
            mailbox = self._words[state.CAN_STUCK_MAILBOX + self._c]
            identifier = self._frame(mailbox, 0).id
            raise FirmwareFault(
                f"CAN{self.controller} is bus-off and transmits {identifier:#x}: mailbox {mailbox} waits for "
                f"{course.STUCK_AFTER_NS / 1e9:g} s, and without ABOM bus-off has no end, {self.mcu.where()}"
            )
        if node.off_rate(self.mcu.state, self._c):
            self._wrong_rate()
        if self._waiting:
            self._waiting = [wanted for wanted in self._waiting if self._still(wanted)]
        for mailbox in range(MAILBOXES):
            if fresh >> mailbox & 1:
                self._waiting.append(self._wanted(mailbox))
        self._waiting.sort(key=lambda wanted: wanted.t_ns)

    def request(self, t_ns: int) -> Transmission | None:
        """The next collected request of `t_ns` or earlier."""
        # A request made in the last basic block may lie past t_ns: it waits for its turn.
        return self._waiting.pop(0) if self._waiting and self._waiting[0].t_ns <= t_ns else None

    def receive(self, frame: Frame, t_ns: int) -> None:
        """The frame's last bit was seen on the bus at `t_ns`."""
        size = len(frame.data)
        head = (frame.id << 3 | IDE if frame.extended else frame.id << 21) | size << 32
        # A signed number, for the compiled code knows no other: few arguments make a cheap call.
        data = int.from_bytes(frame.data, "little", signed=size == _MOST_BYTES)
        if not node.receive(self.mcu.state, self._c, t_ns, head, data):
            self._wrong_rate()

    def sent(self, handle: int, t_ns: int) -> None:
        """The frame in mailbox `handle` was sent."""
        node.sent(self.mcu.state, self._c, t_ns, handle)

    def confinement(self) -> Confinement:
        """How far it takes part in the bus."""
        return Confinement(node.confinement(self.mcu.state, self._c))

    def offer(self, t_ns: int) -> Transmission | None:
        """The frame of the mailbox whose turn it is."""
        mailbox = node.offer(self.mcu.state, self._c, t_ns)
        if mailbox == node.NONE:
            return None
        wanted = self._wanted(mailbox)
        if self._words[state.CAN_MAILBOX + self._c + 4 * mailbox + 1] & TGT:  # its time stamp in the data
            return wanted._replace(frame=self._frame(mailbox, t_ns))
        return wanted

    def started(self, handle: int | None, t_ns: int) -> None:
        """A frame starts on the bus."""
        node.started(self.mcu.state, self._c, t_ns, node.NONE if handle is None else handle)

    def lost(self, handle: int) -> None:
        """Mailbox `handle` lost the arbitration."""
        node.lost(self.mcu.state, self._c, handle)

    def error(self, handle: int | None, error: SeenError, t_ns: int) -> None:
        """An error in the frame under way."""
        sending = node.NONE if handle is None else handle
        node.error(self.mcu.state, self._c, t_ns, sending, int(error.code), error.tec, error.rec)

    def ended(self, t_ns: int) -> None:
        """The bus is free after an error frame."""
        node.ended(self.mcu.state, self._c, t_ns)

    def where(self) -> str:
        """The program counter and the function it is in."""
        return self.mcu.where()

    def _wanted(self, mailbox: int) -> Transmission:
        """The request of a pending mailbox, whose contents stay as they are."""
        words, at = self._words, self._c + mailbox
        order, known = words[state.CAN_TX_ORDER + at], self._known[mailbox]
        if known and known[0] == order:
            return known[1]
        t_ns = words[state.CAN_TX_NS + at]
        wanted = Transmission(t_ns, mailbox, self._frame(mailbox, t_ns))
        self._known[mailbox] = order, wanted
        return wanted

    def _still(self, wanted: Transmission) -> bool:
        """Not aborted, or made anew, since it was collected."""
        pending = mailboxes.is_pending(self.mcu.state, self._c, wanted.handle)
        return bool(pending and self._wanted(wanted.handle) is wanted)

    def _frame(self, mailbox: int, t_ns: int) -> Frame:
        """What `mailbox` would send from `t_ns` on. Raises FirmwareFault for a remote frame."""
        at = state.CAN_MAILBOX + self._c + 4 * mailbox
        tir, tdtr, low, high = self._words[at : at + 4]
        if tdtr & TGT:
            high = int(mailboxes.high_word(self.mcu.state, self._c, mailbox, t_ns))
        extended = bool(tir & IDE)
        identifier = tir >> 3 if extended else tir >> 21
        if tir & RTR:
            raise FirmwareFault(
                f"CAN{self.controller} asks to send a remote frame of {identifier:#x}: buses of the bench "
                f"carry data frames only, {self.mcu.where()}"
            )
        data = (low | high << 32).to_bytes(_MOST_BYTES, "little")
        return Frame(identifier, data[: tdtr & 15], extended)

    def _wrong_rate(self) -> NoReturn:
        raise FirmwareFault(
            f"bxCAN is set to {timing.bitrate(self.mcu.state, self._c)} bit/s on a bus of "
            f"{self._words[state.CAN_BITRATE + self._c]} bit/s, {self.mcu.where()}"
        )

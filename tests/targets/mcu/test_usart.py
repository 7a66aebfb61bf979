"""Serial ports, by RM0090's section 30."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from targets.mcu import textlog, usart
from tests.targets.mcu.board import Board

ADDRESSES = dict(
    zip(usart.NAMES, (0x40011000, 0x40004400, 0x40004800, 0x40004C00, 0x40005000, 0x40011400), strict=True)
)
IRQS = dict(zip(usart.NAMES, (37, 38, 39, 52, 53, 71), strict=True))
USART2 = ADDRESSES["USART2"]
SR, DR, BRR, CR1, CR2, CR3 = (USART2 + offset for offset in range(0, 0x18, 4))
PE, ORE, IDLE, RXNE, TC, TXE = 1, 8, 0x10, 0x20, 0x40, 0x80
UE, OVER8, M, PCE, PS, TE, RE = 1 << 13, 1 << 15, 1 << 12, 1 << 10, 1 << 9, 8, 4
RCC_CFGR = 0x40023808
BIT = 139  # BRR of 115200 baud at 16 MHz
FRAME = 10 * BIT


@pytest.fixture
def board():
    """USART2 at 115200 baud, the idle frame after TE gone by."""
    board = Board()
    board[BRR], board[CR1] = BIT, UE | TE | RE
    board.skip(FRAME)
    return board


def test_registers_have_their_reset_values():
    """SR starts with TXE and TC, all else is zero (section 30.6)."""
    board = Board()
    for base in ADDRESSES.values():
        assert [board[base + offset] for offset in range(0, 0x1C, 4)] == [TXE | TC, 0, 0, 0, 0, 0, 0]


@pytest.mark.parametrize("name", usart.NAMES)
def test_each_port_logs_its_own_bytes(name):
    """What is written to a port comes out there and nowhere else, and raises its interrupt."""
    board, base = Board(), ADDRESSES[name]
    board[base + 8], board[base + 12] = 16, UE | TE | TC
    board.sleep(1000)
    board[base + 4] = 0x55
    board.sleep(159)
    assert textlog.output(board, name) == b""
    board.sleep(1)
    assert {n: textlog.output(board, n) for n in usart.NAMES} == {n: b"U" * (n == name) for n in usart.NAMES}
    assert board.lines() == {IRQS[name]}


def test_idle_frame_goes_first():
    """Setting TE sends an idle frame before the first byte (section 30.3.2)."""
    board = Board()
    board[BRR], board[CR1] = BIT, UE | TE
    board[DR] = 0x41
    assert not board[SR] & TXE
    board.skip(FRAME)
    assert board[SR] & TXE
    board.skip(FRAME)
    assert textlog.log(board, "USART2").ns.tolist() == [2 * FRAME * 1000 // 16]


@given(
    brr=st.integers(16, 0xFFFF),
    over8=st.booleans(),
    long=st.booleans(),
    stop=st.integers(0, 3),
    ppre=st.sampled_from([0, 4, 7]),
    text=st.binary(min_size=1, max_size=5),
)
def test_bytes_take_their_baud_rate(brr, over8, long, stop, ppre, text):
    """A frame of 1 start, 8 or 9 data and 0.5 to 2 stop bits takes USARTDIV x 8 x (2 - OVER8) clocks a bit
    (sections 30.3.2 and 30.3.4); back to back there is nothing in between.
    """
    board = Board()
    board[RCC_CFGR] = ppre << 10
    board[BRR], board[CR2] = brr, stop << 12
    board[CR1] = UE | TE | (OVER8 if over8 else 0) | (M if long else 0)
    usartdiv = (brr >> 4) + (brr & 7) / 8 if over8 else brr / 16
    bits = 1 + (9 if long else 8) + (1, 0.5, 2, 1.5)[stop]
    clocks = usartdiv * (8 if over8 else 16) * bits * {0: 1, 4: 2, 7: 16}[ppre]
    frame = int(clocks)  # a half bit may end between two clocks
    for byte in text:
        while not board[SR] & TXE:
            board.skip(max(1, frame // 7))
        board[DR] = byte
    board.skip(3 * frame)
    log = textlog.log(board, "USART2")
    assert log.data.tobytes() == text
    assert log.ns.tolist() == [(2 + k) * frame * 1000 // 16 for k in range(len(text))]


def test_transmit_flags(board):
    """DR written: TXE falls if the shift register is busy; TC rises after the last frame (section 30.3.2)."""
    board[SR] = 0
    assert board[SR] == TXE
    board[DR] = 1
    assert board[SR] == TXE
    board[DR] = 2
    assert board[SR] == 0
    board.skip(FRAME)
    assert board[SR] == TXE
    board.skip(FRAME)
    assert board[SR] == TXE | TC


def test_transmission_complete_is_cleared_by_the_next_byte(board):
    """TC falls by a read of SR and a write of DR, or by writing zero (section 30.6.1)."""
    board[DR] = 1
    board.skip(FRAME)
    assert board[SR] & TC
    board[DR] = 2
    assert not board[SR] & TC
    board.skip(FRAME)
    board[SR] = ~TC & 0xFFFF
    assert not board[SR] & TC


def test_transmit_interrupts_come_on_time(board):
    """TXEIE calls at the moment DR is free again, TCIE after the last bit."""
    board[DR] = 1
    board[DR] = 2
    board[CR1] |= TXE
    assert board.lines() == set()
    assert board.sleep(FRAME + 10) == 1
    assert board.lines() == {38}
    board[CR1] = UE | TE | TC
    board[SR] = 0
    assert board.lines() == set()
    board.sleep(FRAME)
    assert board.lines() == {38}


def test_received_bytes(board):
    """Fed bytes arrive one frame after the other; RXNE until DR is read (section 30.3.3)."""
    textlog.feed(board, "USART2", b"hi")
    board.skip(FRAME - 1)
    assert not board[SR] & RXNE
    board.skip(1)
    assert board[SR] & RXNE
    assert board[DR] == ord("h")
    assert not board[SR] & RXNE
    board.skip(FRAME)
    assert board[DR] == ord("i")
    assert textlog.unheard(board, "USART2") == 0


def test_receive_interrupt_comes_on_time(board):
    """RXNEIE calls when the byte is complete."""
    board[CR1] |= RXNE
    textlog.feed(board, "USART2", b"a")
    assert board.sleep(FRAME - 1) == 0
    assert board.lines() == set()
    board.sleep(1)
    assert board.lines() == {38}
    assert board[DR] == ord("a")
    assert board.lines() == set()


def test_overrun(board):
    """A byte on top of one not read is lost and sets ORE; SR then DR clears it (section 30.3.3)."""
    textlog.feed(board, "USART2", b"abc")
    board.skip(3 * FRAME)
    assert board[SR] & (ORE | RXNE) == ORE | RXNE
    assert board[DR] == ord("a")
    assert not board[SR] & (ORE | RXNE)
    assert textlog.unheard(board, "USART2") == 2


def test_data_read_without_status_keeps_the_error(board):
    """ORE falls only if SR was read before DR (section 30.6.1)."""
    textlog.feed(board, "USART2", b"ab")
    board.skip(2 * FRAME)
    assert board[DR] == ord("a")
    assert board[SR] & ORE
    assert board[DR] == ord("a")
    assert not board[SR] & ORE


def test_overrun_raises_the_receive_interrupt(board):
    """ORE alone keeps the line up (section 30.4)."""
    board[CR1] |= RXNE
    textlog.feed(board, "USART2", b"ab")
    board.skip(2 * FRAME)
    board.read(DR)
    assert board.lines() == {38}


def test_idle_line(board):
    """A frame's time after the last byte IDLE rises, once (section 30.3.3)."""
    board[CR1] |= IDLE
    textlog.feed(board, "USART2", b"ab")
    board.sleep(3 * FRAME - 1)
    assert not board[SR] & IDLE
    board.sleep(1)
    assert board.lines() == {38}
    assert board[SR] & IDLE
    board.read(DR)
    board.sleep(10 * FRAME)
    assert not board[SR] & IDLE


def test_narrow_write_of_the_status_does_not_read_it(board):
    """A byte written to SR clears no errors, as a read followed by one of DR would."""
    textlog.feed(board, "USART2", b"ab")
    board.skip(2 * FRAME)
    board.write(SR, 0xFF, size=1)
    board.write(DR + 1, 0, size=1)
    assert board[SR] & (ORE | RXNE) == ORE | RXNE


def test_byte_access_to_data(board):
    """DR may be written and read by bytes."""
    board.write(DR, 0x5A, size=1)
    textlog.feed(board, "USART2", b"\xa5")
    board.skip(FRAME)
    assert board.read(DR, size=1) == 0xA5
    assert textlog.output(board, "USART2") == b"\x5a"


@pytest.mark.parametrize(
    ("control", "value", "read"),
    [(0, 0xFF, 0xFF), (PCE, 0x41, 0x41), (PCE, 0x43, 0xC3), (PCE | PS, 0x41, 0xC1), (PCE | M, 0xC1, 0x1C1)],
    ids=["none", "even", "even-odd-ones", "odd", "nine-bits"],
)
def test_parity_takes_a_bit(board, control, value, read):
    """With PCE the frame's last bit is the parity, which DR shows and the log does not (30.3.6)."""
    board[CR1] |= control
    textlog.feed(board, "USART2", bytes([value]))
    board.skip(2 * FRAME)
    assert board[DR] == read
    board[DR] = read
    board.skip(2 * FRAME)
    assert textlog.output(board, "USART2") == bytes([value])


def test_nobody_listening(board):
    """Bytes for a receiver that is off are counted."""
    board[CR1] = UE | TE
    textlog.feed(board, "USART2", b"abc")
    board.skip(10 * FRAME)
    assert textlog.unheard(board, "USART2") == 3
    assert not board[SR] & RXNE


def test_transmitter_that_is_off_sends_nothing(board):
    """Without TE, or without a baud rate, DR goes nowhere."""
    board[CR1] = UE | RE
    board[DR] = 1
    board[BRR] = 0
    board[CR1] = UE | TE
    board[DR] = 2
    board.skip(10 * FRAME)
    assert textlog.output(board, "USART2") == b""


@pytest.mark.parametrize(
    ("register", "value"),
    [(CR1, 1), (CR1, 2), (CR2, 1 << 14), (CR2, 1 << 11), (CR3, 1 << 7), (CR3, 8)],
    ids=["break", "mute", "lin", "clock", "dma", "half-duplex"],
)
def test_what_is_not_modelled_is_counted(board, register, value):
    """Break, mute mode, LIN, synchronous clock, DMA and half duplex are counted by their register."""
    board[register] = board[register]
    assert board.unmodelled == set()
    board[register] |= value
    assert board.unmodelled == {register}


def test_text_survives_a_clock_change(board):
    """What was sent before a change of the clock keeps its time."""
    board[DR] = 0x41
    board.skip(FRAME)
    now = (board.now * 1000) // 16
    board[RCC_CFGR] = 0x80  # HCLK / 2
    board.skip(1000)
    assert textlog.log(board, "USART2").ns.tolist() == [now]

"""What GDB is answered, packet by packet."""

from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.gdb.description import REGISTERS
from bench.gdb.stub import INTERRUPTED, PACKET_SIZE, TRAPPED, Stop, Stub, Want
from bench.gdb.wire import Decoder, Packet, encode
from tests.bench.gdb.conftest import BASE, Machine


def new(machine=None) -> Stub:
    return Stub(machine or Machine(), {"time": lambda: "0.1 s", "cycles": lambda: "2200000"})


@pytest.fixture
def stub(machine):
    return new(machine)


def payload(line: bytes) -> bytes:
    """The one reply in what the stub sent."""
    (packet,) = (event for event in Decoder().feed(line) if isinstance(event, Packet))
    return packet.data


def ask(stub: Stub, request: bytes) -> bytes:
    return payload(stub.receive(encode(request)))


def registers_of(answer: bytes) -> dict[str, int]:
    """The `g` packet's content by name."""
    raw, values, at = bytes.fromhex(answer.decode()), {}, 0
    for register in REGISTERS:
        values[register.name] = int.from_bytes(raw[at : at + register.bits // 8], "little")
        at += register.bits // 8
    assert at == len(raw)
    return values


def test_all_registers(stub, machine):
    """g gives every register, little-endian, and G writes them all."""
    assert registers_of(ask(stub, b"g")) == machine.values
    raw = b"".join((7 * k).to_bytes(register.bits // 8, "little") for k, register in enumerate(REGISTERS))
    assert ask(stub, b"G" + raw.hex().encode()) == b"OK"
    assert machine.values == {register.name: 7 * k for k, register in enumerate(REGISTERS)}
    assert ask(stub, b"G" + raw[1:].hex().encode()) == b"E01"


def test_one_register(stub, machine):
    """p reads and P writes one register by its number in the description."""
    assert ask(stub, b"pf") == b"0f000000"
    assert ask(stub, b"Pf=78563412") == b"OK"
    assert machine.values["pc"] == 0x12345678
    assert ask(stub, b"P11=0000000000000440") == b"OK"
    assert machine.values["d0"] == 0x4004000000000000


def test_memory(stub, machine):
    """m reads, M writes hexadecimal and X binary, whatever the bytes."""
    assert ask(stub, b"m20000010,4") == b"10111213"
    assert ask(stub, b"M20000010,2:abcd") == b"OK"
    assert ask(stub, b"X20000012,4:$#}*") == b"OK"
    assert machine.memory[0x10:0x17] == b"\xab\xcd$#}*\x16"


def test_memory_that_is_not_there(stub):
    """Reading and writing where there is nothing is E01; reading across the end gives what there is."""
    assert ask(stub, b"m0,4") == b"E01"
    assert ask(stub, b"M0,1:00") == b"E01"
    assert ask(stub, b"X0,1:0") == b"E01"
    assert ask(stub, b"m2000fffe,4") == b"feff"
    assert ask(stub, b"mffffffffffffffff,4") == b"E01"


def test_nothing_of_memory(stub):
    """No bytes are read and written anywhere; GDB asks so whether binary writes are understood."""
    assert ask(stub, b"X0,0:") == b"OK"
    assert ask(stub, b"m0,0") == b""


def test_a_reply_fits_its_packet(stub):
    """However much memory is asked for, the reply stays within the size that was announced."""
    assert 0 < len(encode(ask(stub, b"m20000000,ffff"))) <= PACKET_SIZE


@pytest.mark.parametrize(
    ("request_", "want"),
    [
        (b"c", Want.RUN),
        (b"s", Want.STEP),
        (b"C05", Want.RUN),
        (b"S05", Want.STEP),
        (b"vCont;c", Want.RUN),
        (b"vCont;s:1;c", Want.STEP),
        (b"vCont;s:2;c:1", Want.RUN),
        (b"vCont;S05:-1", Want.STEP),
        (b"k", Want.KILL),
    ],
)
def test_what_lets_it_run(stub, request_, want):
    """Continue, step and kill are acknowledged, without a reply until the machine halts."""
    assert stub.receive(encode(request_)) == b"+"
    assert stub.want is want


@pytest.mark.parametrize(("request_", "want"), [(b"D", Want.DETACH), (b"vKill;1", Want.KILL)])
def test_goodbye(stub, request_, want):
    """Detaching, and killing politely, are answered with OK."""
    assert ask(stub, request_) == b"OK"
    assert stub.want is want


def test_continue_at_an_address(stub, machine):
    """c and s with an address set the program counter first."""
    stub.receive(encode(b"c8000100"))
    assert machine.values["pc"] == 0x08000100
    stub.stopped(Stop(TRAPPED))
    stub.receive(encode(b"S05;8000200"))
    assert machine.values["pc"] == 0x08000200


def test_why_it_stopped(stub):
    """The reason of the last halt is sent when it comes, and given again when asked for."""
    assert ask(stub, b"?") == b"T05thread:1;"
    stub.receive(encode(b"c"))
    assert payload(stub.stopped(Stop(INTERRUPTED))) == b"T02thread:1;"
    assert stub.want is Want.HALT
    assert ask(stub, b"?") == b"T02thread:1;"


def test_watchpoint_that_was_hit(stub):
    """A halt at a watchpoint names its kind and address; one at a breakpoint needs none."""
    stub.receive(encode(b"c"))
    assert payload(stub.stopped(Stop(TRAPPED, ("write", 0x20000004)))) == b"T05watch:20000004;thread:1;"
    stub.receive(encode(b"c"))
    assert payload(stub.stopped(Stop(TRAPPED, ("break", 0x08000004)))) == b"T05thread:1;"


def test_text_for_the_console(stub):
    """What a halt has to say is shown on the debugger's console before the halt itself."""
    stub.receive(encode(b"c"))
    events = Decoder().feed(stub.stopped(Stop(11, text="no")))
    assert events == [Packet(b"O" + b"no".hex().encode()), Packet(b"T0bthread:1;")]


def test_interrupt(stub):
    """0x03 interrupts a machine that runs, once; one that is halted does not mind."""
    assert stub.receive(b"\x03") == b""
    assert not stub.interrupted
    stub.receive(encode(b"c"))
    stub.receive(b"\x03")
    assert stub.interrupted
    stub.stopped(Stop(INTERRUPTED))
    stub.receive(encode(b"c"))
    assert not stub.interrupted


def test_packets_wait_while_it_runs(stub):
    """A packet for a machine that runs waits until it has halted; an interrupt behind it does not."""
    assert stub.receive(encode(b"c") + encode(b"pf") + b"\x03") == b"+"
    assert stub.interrupted
    assert [e.data for e in Decoder().feed(stub.stopped(Stop(2))) if isinstance(e, Packet)] == [
        b"T02thread:1;",
        b"0f000000",
    ]


def test_points(stub, machine):
    """Z sets and z clears points; one that cannot be is E01, one of unknown kind gets an empty reply."""
    for number, kind in ((0, "break"), (1, "break"), (2, "write"), (3, "read")):
        assert ask(stub, b"Z%d,20000000,4" % number) == b"OK"
        assert machine.points == [(kind, BASE, 4)]
        assert ask(stub, b"z%d,20000000,4" % number) == b"OK"
        assert machine.points == []
    assert ask(stub, b"Z4,20000000,4") == b"E01"
    assert ask(stub, b"z1,20000000,4") == b"E01"
    assert ask(stub, b"Z5,20000000,4") == b""


def test_damaged_packet_is_asked_for_again(stub):
    """A packet with a wrong sum is answered with -, and - gets the last reply again."""
    assert stub.receive(b"$pf#00") == b"-"
    answer = stub.receive(b"$pf#d6")
    assert stub.receive(b"-") == answer[1:]
    assert stub.receive(b"+") == b""


def test_without_acknowledgements(stub):
    """After QStartNoAckMode neither + nor - is sent."""
    assert stub.receive(encode(b"QStartNoAckMode")) == b"+" + encode(b"OK")
    assert stub.receive(encode(b"pf")) == encode(b"0f000000")
    assert stub.receive(b"$pf#00") == b""


def test_features(stub):
    """What is announced is what GDB needs to ask for the description and to leave out acknowledgements."""
    features = ask(stub, b"qSupported:multiprocess+;swbreak+").split(b";")
    assert {b"qXfer:features:read+", b"vContSupported+", b"QStartNoAckMode+"} < set(features)
    assert b"PacketSize=%x" % PACKET_SIZE in features
    assert ask(stub, b"vCont?") == b"vCont;c;C;s;S"


def test_target_description(stub):
    """The description comes in parts and is XML of M-profile, FPU and system registers."""
    xml, part = b"", b"m"
    while part[:1] == b"m":
        part = ask(stub, b"qXfer:features:read:target.xml:%x,80" % len(xml))
        xml += part[1:]
    root = ElementTree.fromstring(xml)
    features = {f.get("name"): [r.get("name") for r in f] for f in root.iter("feature")}
    assert set(features) == {f"org.gnu.gdb.arm.{name}" for name in ("m-profile", "vfp", "m-system")}
    assert features["org.gnu.gdb.arm.m-profile"][13:] == ["sp", "lr", "pc", "xpsr"]
    assert features["org.gnu.gdb.arm.vfp"][-2:] == ["d15", "fpscr"]
    assert ask(stub, b"qXfer:features:read:other.xml:0,80") == b""


def test_monitor(stub):
    """monitor NAME gives the machine's own report, another name the list of those there are."""
    assert bytes.fromhex(ask(stub, b"qRcmd," + b"time".hex().encode()).decode()) == b"0.1 s\n"
    answer = bytes.fromhex(ask(stub, b"qRcmd," + b"help".hex().encode()).decode())
    assert answer == b"no command 'help'; there are time, cycles\n"


@pytest.mark.parametrize(
    "request_",
    [
        b"p", b"pff", b"p-1", b"p 1", b"P1=0", b"P1=00000000ff", b"P1", b"m", b"m1", b"m1,2,3", b"mx,1",
        b"m,", b"M20000000,2:00", b"M20000000,1:0", b"M20000000,1:zz", b"X20000000,2:a", b"G00", b"Gzz",
        b"Z1,1", b"Z1", b"vCont;", b"vCont;x", b"vCont;c:2", b"czz", b"qRcmd,1",
        b"qXfer:features:read:target.xml:",
        b"m20000000,99999999999999999", b"Z0,,",
    ],
)  # fmt: skip
def test_malformed(stub, machine, request_):
    """What makes no sense is E01, changes nothing and lets nothing run."""
    registers, memory = dict(machine.values), bytes(machine.memory)
    assert ask(stub, request_) == b"E01"
    assert (machine.values, machine.memory) == (registers, memory)
    assert machine.points == []
    assert stub.want is Want.HALT


@pytest.mark.parametrize(
    "request_", [b"", b"vMustReplyEmpty", b"qCRC:0,4", b"!", b"i", b"Z9,0,0", b"\xff\x00"]
)
def test_unknown(stub, request_):
    """What is not understood gets an empty reply."""
    assert ask(stub, request_) == b""


def test_threads(stub):
    """There is one thread."""
    assert [ask(stub, q) for q in (b"qC", b"qfThreadInfo", b"qsThreadInfo", b"Hg0", b"T1", b"qAttached")] == [
        b"QC1", b"m1", b"l", b"OK", b"OK", b"1",
    ]  # fmt: skip


COMMANDS = st.sampled_from(
    [b"g", b"G", b"p", b"P", b"m", b"M", b"X", b"c", b"s", b"C", b"S", b"vCont;", b"Z", b"z", b"qRcmd,",
     b"qXfer:features:read:target.xml:", b"H", b"D", b"k", b"?", b"q", b"Q", b"v"]
)  # fmt: skip
ARGUMENTS = st.text("0123456789abcdefg,;:=-x ", max_size=30).map(str.encode) | st.binary(max_size=20)


@given(
    st.lists(st.binary(max_size=60) | st.builds(lambda a, b: encode(a + b), COMMANDS, ARGUMENTS), max_size=8)
)
def test_any_bytes(pieces):
    """Nothing a debugger sends raises, halted or running, and the stub goes on answering."""
    stub = new()
    for piece in pieces:
        stub.receive(piece)
        if stub.want is not Want.HALT:
            stub.stopped(Stop(TRAPPED))
    stub.receive(b"#00")
    while stub.want is not Want.HALT:
        stub.stopped(Stop(TRAPPED))
    assert b"QC1" in stub.receive(encode(b"qC"))

"""`bench firmware gdb`: GDB itself at the other end, what is refused, and how a session ends."""

import os
import re
import shutil
import signal
import socket
import subprocess
import threading
from collections.abc import Callable

import pytest

from bench.gdb.wire import Decoder, Packet, encode
from bench.laps.files import write_lap
from targets.firmware import ELF
from tests.conftest import wavy_lap

PATIENCE_S = 120
GDB = "gdb-multiarch"


@pytest.fixture
def served(bench, monkeypatch) -> Callable:
    """Call `bench firmware gdb WORD...` with `debugger(port)` beside it: how it ended, what that returned."""
    listening = socket.create_server

    def call(debugger, *words):
        address, returned = [], []
        ready = threading.Event()

        def create_server(where, **options):
            server = listening(where, **options)
            address.extend(server.getsockname())
            ready.set()
            return server

        def beside():
            ready.wait()
            try:
                returned.append(debugger(address[1]))
            except Exception as error:  # raised again where the test sees it
                returned.append(error)

        monkeypatch.setattr(socket, "create_server", create_server)
        thread = threading.Thread(target=beside)
        thread.start()
        ended = bench("firmware", "gdb", "--port", 0, *words)
        ready.set()  # had it been refused, nobody would be waited for
        thread.join()
        assert address[:1] == ["127.0.0.1"], ended.err
        if isinstance(returned[0], Exception):
            raise returned[0]
        return ended, returned[0]

    return call


@pytest.fixture
def short(tmp_path):
    """A lap of thirty cycles."""
    write_lap(wavy_lap(0.3), tmp_path / "short.csv")
    return tmp_path / "short.csv"


def turned_away(address) -> bool:
    """Whether a second debugger gets no word: refused, or cut off if it came just before the door shut."""
    try:
        with socket.create_connection(address, timeout=PATIENCE_S) as second:
            return second.recv(1) == b""
    except (ConnectionRefusedError, ConnectionResetError):
        return True


def connected(talk) -> Callable:
    """A debugger that does `talk(connection)`."""

    def debugger(port):
        with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S) as connection:
            return talk(connection)

    return debugger


def ask(connection: socket.socket, request: bytes, more: bytes = b"") -> bytes:
    """The first packet that comes after `request` and what is sent behind it."""
    connection.sendall(encode(request) + more)
    decoder = Decoder()
    while True:
        for event in decoder.feed(connection.recv(4096)):
            if isinstance(event, Packet):
                return event.data


@pytest.mark.skipif(shutil.which(GDB) is None, reason=f"no {GDB}: apt-get install gdb-multiarch")
def test_gdb(served, short):
    """GDB breaks, names functions, steps, watches, reads and writes registers and memory, and goes."""
    script = """
        set pagination off
        set confirm off
        target remote :{port}
        break main
        continue
        backtrace
        tbreak can1_rx0_handler
        continue
        backtrace
        finish
        hbreak ecu_step
        continue
        backtrace
        set $r1 = 0x1234
        info registers
        stepi
        info registers pc
        watch state.step
        continue
        next
        print $s0
        set var state.missed = 7
        print state.missed
        print can_waiting()
        x/xw 0x40006404
        x/xw 0x30000000
        compare-sections .text
        monitor time
        monitor frames
        monitor reset
        maintenance flush register-cache
        print $pc
        detach
    """

    def debugger(port):
        words = [GDB, "-nx", "-q", str(ELF["ifd"])]
        run = subprocess.run(
            words,
            input=script.format(port=port),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        return run.stdout

    ended, said = served(debugger, "--lap", short)
    assert (ended.code, ended.out) == (0, "")
    assert f"{GDB} -d " in ended.err
    assert ended.err.endswith("the debugger has left\n")
    for line in (
        r"reset_handler \(\) at stm32f405/startup.c",
        r"Breakpoint 1, main \(\) at stm32f405/main.c",
        r"#0  can1_rx0_handler \(\).*\n#1  <signal handler called>\n#2 .* in sleep_until_frame \(\)",
        r"Breakpoint 3, ecu_step \(e=e@entry=0x[0-9a-f]+ <state>\) at core/ecu.c",
        r"#1  0x[0-9a-f]+ in answer \(\).*\n#2  main \(\)",
        r"r1 +0x1234 ",
        r"msp +0x2001[0-9a-f]+ ",
        r"control +0x4 ",
        r"pc .*<ecu_step\+[24]>",
        r"Hardware watchpoint 4: state.step\n\nOld value = 0\nNew value = 1\n",
        r"\$2 = 7\n",
        r"0x40006404:\s+0x00000c00",
        r"Cannot access memory at address 0x30000000",
        r"Section .text.*: matched",
        r"0\.000\d+ s",
        r"\d frames came over the bus, 0 were requested",
        r"power cycled",
        r"\$4 = .*<reset_handler>",
        r"Remote target\) detached",
    ):
        assert re.search(line, said), f"no {line} in:\n{said}"


def test_lives_with_whatever_is_sent(served, short):
    """Noise, damaged packets and requests that make no sense are answered, and the ECU is still there."""

    def talk(connection):
        connection.sendall(
            b"\x00\xff$#00$zz#12-+\x03" + encode(b"P") + b"$m0" + encode(b"mffff,ff") + b"\x03"
        )
        replies = [ask(connection, b"qC") for _ in range(6)]
        connection.sendall(encode(b"k"))
        return replies

    ended, replies = served(connected(talk), "--lap", short)
    assert ended.code == 0
    assert replies[-1] == b"QC1"


def test_interrupt(served, short):
    """0x03 halts the machine, whether a lap is being ridden or, after its end, the bus is silent."""

    def talk(connection):
        seconds = -0.1
        for _ in range(2000):
            assert ask(connection, b"vCont;c", b"\x03") == b"T02thread:1;"
            reply = ask(connection, b"qRcmd," + b"time".hex().encode())
            earlier, seconds = seconds, float(bytes.fromhex(reply.decode()).split()[0])
            assert earlier <= seconds < earlier + 0.02  # soon, in the machine's time
            if seconds > 0.35:
                return ask(connection, b"D")
        raise AssertionError(f"still at {seconds} s")

    ended, reply = served(connected(talk), "--lap", short)
    assert reply == b"OK"
    assert "the lap is over at 0.310 s\n" in ended.err


@pytest.mark.parametrize("words", [(), ("--silent",)], ids=["lap", "silent"])
def test_one_debugger(served, short, words):
    """While one debugger is served no other can connect, and when its connection breaks the command ends."""

    def talk(connection):
        assert turned_away(connection.getpeername())
        connection.sendall(encode(b"vCont;c"))

    ended, _ = served(connected(talk), *(words or ("--lap", short)))
    assert ended.code == 0
    assert ended.err.endswith("the debugger has left\n")


def test_what_was_loaded_stays(served, image):
    """What a debugger wrote into flash is there after a reset; RAM and time are as at power-on."""
    unused = 0x08008000

    def talk(connection):
        seen = [ask(connection, b"M%x,4:12345678" % unused), ask(connection, b"M20000000,1:77")]
        ask(connection, b"qRcmd," + b"reset".hex().encode())
        seen += [ask(connection, b"m%x,4" % unused), ask(connection, b"m20000000,1"), ask(connection, b"pf")]
        return seen

    _, seen = served(connected(talk), "--silent")
    reset = image.symbol("reset_handler").to_bytes(4, "little").hex().encode()
    assert seen == [b"OK", b"OK", b"12345678", b"00", reset]


def test_any_firmware(served, tmp_path, arm_gcc):
    """A firmware that knows neither calibration nor CAN runs as well, on a silent bus."""
    source, elf = tmp_path / "bare.s", tmp_path / "bare.elf"
    source.write_text(
        ".syntax unified\n.thumb\n.word 0x20001000\n.word start\n"
        ".thumb_func\n.global start\nstart: adds r0, #1\n.global loop\n.thumb_func\nloop: b loop\n"
    )
    flags = ["-mcpu=cortex-m4", "-nostdlib", "-Wl,-Ttext=0x08000000", "-Wl,--build-id=none", "-Wl,-e,start"]
    subprocess.run(["arm-none-eabi-gcc", *flags, str(source), "-o", str(elf)], check=True)

    def talk(connection):
        return [ask(connection, request) for request in (b"Z0,800000a,2", b"c", b"p0", b"pf", b"D")]

    ended, seen = served(connected(talk), elf)
    assert seen == [b"OK", b"T05thread:1;", b"01000000", b"0a000008", b"OK"]
    assert f"connect with: {GDB} {elf} -ex 'target remote :" in ended.err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["INT", "TERM"])
def test_stopped(bench, monkeypatch, number):
    """Ctrl-C and SIGTERM end the wait for a debugger without a word and with exit code 0."""
    monkeypatch.setattr(socket.socket, "accept", lambda server: os.kill(os.getpid(), number))
    ended = bench("firmware", "gdb", "--silent", "--port", 0)
    assert ended.code == 0
    assert ended.err.startswith("halted in reset; connect with: ")
    assert ended.err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("none.elf",), "firmware: none.elf: no such file"),
        (("--ecu", "abs"), "ecu: no ECU abs; there are ifd, soft_sensor"),
        (("--model", "none.json"), "calibration: none.json: no such file"),
        (("--lap", "none.csv"), "lap: none.csv: no such file"),
        (("--lap", "LAP", "--fault", "rear_stroke"), "fault: 'rear_stroke' has no @TIME"),
        (("--silent", "--host", "192.0.2.1"), "gdb: 192.0.2.1:"),
        (("--silent", "--host", "no such host"), "gdb: no such host:"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_refused(refused, short, words, says):
    """What is wrong is refused in one line before anyone can connect."""
    assert says in refused(
        "firmware", "gdb", "--port", 0, *(short if word == "LAP" else word for word in words)
    )


def test_port_in_use(refused):
    """A port that somebody listens on is refused by its number."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        says = refused("firmware", "gdb", "--silent", "--port", port)
    assert f"gdb: 127.0.0.1:{port}: address already in use" in says

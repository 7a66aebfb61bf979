"""`bench mcu` from the command line: what it prints, writes, refuses, and how it ends."""

import json
import os
import signal
import struct

import pytest

from bench import solo
from bench.bus.live import LiveBus
from tests.targets.mcu.made import ALLOC, NOTYPE, OBJECT, WRITE, Part, Symbol, elf, vectors
from tests.targets.mcu.programs import built

FLASH, SRAM = 0x08000000, 0x20000000

# reset at 8: bl count at 16; wfi; b back to the wfi. count at 16, twice at 28, hang at 32, load at 34.
CODE = vectors() + bytes.fromhex(
    "00f0 02f8  30bf  fde7"  # bl count; wfi; b.n -2
    "0068 0130 0149 0860 7047 00bf 00000020"  # r0 = [r0] + 1; [0x20000000] = r0; bx lr
    "4000 7047"  # lsls r0, r0, #1; bx lr
    "fee7"  # b .
    "0068 7047"  # r0 = [r0]; bx lr
)
SYMBOLS = (
    *(Symbol("reset", FLASH + 9), Symbol("count", FLASH + 17), Symbol("twice", FLASH + 33)),
    *(Symbol("hang", FLASH + 37), Symbol("load", FLASH + 39), Symbol("number", SRAM, OBJECT)),
    *(Symbol("$t", FLASH + 8, NOTYPE), Symbol("$d", FLASH + 28, NOTYPE), Symbol("$t", FLASH + 32, NOTYPE)),
)
PARTS = (Part(".text", FLASH, CODE), Part(".data", SRAM, struct.pack("<I", 6), flags=ALLOC | WRITE))


@pytest.fixture
def file(tmp_path):
    """A small firmware: its reset handler counts at address 0 and sleeps."""
    path = tmp_path / "small.elf"
    path.write_bytes(elf(*PARTS, symbols=SYMBOLS))
    return path


@pytest.fixture
def stripped(tmp_path):
    """The same without symbols."""
    path = tmp_path / "stripped.elf"
    path.write_bytes(elf(*PARTS))
    return path


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out.json"


def test_call(bench, file, out):
    """A call says its cycles with their bounds, instructions and result, on the screen and as JSON."""
    said = bench("mcu", "call", file, "count", "&number", "--dump", "number:4", "--clock", 24, "--json", out)
    assert (said.code, said.err) == (0, "")
    result = json.loads(out.read_text())
    assert (result["r0"], result["instructions"]) == (7, 5)
    assert result["dump"] == {"number": "07000000"}
    assert result["arguments"] == [SRAM]
    assert all(isinstance(result[key], int) for key in ("cycles", "optimistic", "pessimistic", "r1"))
    assert result["cycles"] >= 5
    assert result["microseconds"] == pytest.approx(result["cycles"] / 24)
    assert f"cycles        {result['cycles']} (optimistic {result['optimistic']}, " in said.out
    assert "instructions  5, " in said.out
    assert "r0 = 7 (0x00000007)" in said.out
    assert "number: 07000000" in said.out


def test_call_as_json_alone(bench, file):
    """With --json - the output is the document and nothing else."""
    said = bench("mcu", "call", file, "twice", "-21", "--json", "-")
    assert (said.code, said.err) == (0, "")
    assert json.loads(said.out)["r0"] == 2**32 - 42


def test_call_repeated(bench, file, out):
    """Repeated calls each find memory as loaded; with --keep as the one before left it."""
    bench("mcu", "call", file, "count", "&number", "--repeat", 3, "--dump", "number:4", "--json", out)
    result = json.loads(out.read_text())
    assert result["dump"] == {"number": "07000000"}
    assert result["repeat"]["count"] == 3
    assert result["repeat"]["mean"] == result["repeat"]["min"] == result["repeat"]["max"] == result["cycles"]
    assert result["repeat"]["sd"] == 0
    said = bench(
        *("mcu", "call", file, "count", "&number", "--repeat", 3, "--keep"),
        *("--dump", "number:4", "--json", out),
    )
    kept = json.loads(out.read_text())
    assert (kept["r0"], kept["dump"]) == (7, {"number": "09000000"})
    assert f"3 calls, all of {kept['cycles']} cycles" in said.out


def test_calls_that_differ(bench, file, monkeypatch):
    """Calls of different cost are summed up with mean, standard deviation and range."""
    from targets.mcu.call import Caller, Outcome

    costs = iter((10, 12, 14))
    monkeypatch.setattr(Caller, "call", lambda *_: Outcome(next(costs), 9, 15, 5, 0, 0))
    said = bench("mcu", "call", file, "twice", "--repeat", 3)
    assert "cycles        10 (optimistic 9, pessimistic 15)" in said.out
    assert "3 calls: mean 12.0 cycles, sd 2.00, 10 to 14" in said.out


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("none",), "firmware: FILE: no symbol none"),
        (("number",), "firmware: FILE: number at 0x20000000 is data, not code"),
        (("twice", "x"), "firmware: argument 'x' is neither an integer nor &symbol"),
        (("twice", "--bogus"), "firmware: argument '--bogus' is neither an integer nor &symbol"),
        (("twice", "&none"), "firmware: FILE: no symbol none"),
        (("twice", "0x100000000"), "firmware: argument 0x100000000 does not fit 32 bits"),
        (("twice", "--clock", "0"), "bench: --clock is 0 MHz; it must be within 0.001 and 168"),
        (("twice", "--clock", "nan"), "bench: --clock is nan MHz"),
        (("twice", "--clock", "169"), "bench: --clock is 169 MHz"),
        (("twice", "--wait-states", "8"), "bench: --wait-states is 8; it must be within 0 and 7"),
        (("twice", "--repeat", "0"), "bench: --repeat is 0; it must be at least 1"),
        (("twice", "--limit", "0"), "bench: --limit is 0; it must be at least 1"),
        (("twice", "--stack", "top"), "bench: --stack is top, which is no address"),
        (("twice", "--stack", "0x40000000"), "bench: --stack is 0x40000000; it must lie in RAM"),
        (("twice", "--stack", "0x20000000"), "bench: --stack is 0x20000000; it must lie in RAM"),
        (("twice", "--dump", "number"), "bench: --dump is number; it must be SYMBOL:BYTES"),
        (("twice", "--dump", "number:x"), "bench: --dump is number:x; it must be SYMBOL:BYTES"),
        (("twice", "--dump", "number:0"), "bench: --dump is number:0: 0 bytes at 0x20000000 do not lie"),
        (("twice", "--dump", "number:999999"), "bench: --dump is number:999999: 999999 bytes at 0x20000000"),
        (("twice", "--dump", "none:4"), "firmware: FILE: no symbol none"),
        (("twice", "--json", "/none/out.json"), "record: /none/out.json: no folder /none"),
    ],
)
def test_call_refused(refused, file, words, complaint):
    """Bad input is one line and exit code 2."""
    assert refused("mcu", "call", file, *words).startswith(f"bench: {complaint}".replace("FILE", str(file)))


def test_call_of_a_stripped_file(refused, stripped):
    """A file without symbols has no function to call."""
    assert refused("mcu", "call", stripped, "main") == f"bench: firmware: {stripped}: has no symbols\n"


def test_call_that_does_not_return(refused, file):
    """A function that never returns is a fault, with where it stands."""
    said = refused("mcu", "call", file, "hang", "--limit", 10_000)
    assert (
        said == "bench: firmware fault: hang has not returned after 10000 cycles at pc 0x08000024 in hang\n"
    )


def test_call_that_faults(refused, file):
    """A function that reads where nothing is is a fault, with where it stands."""
    said = refused("mcu", "call", file, "load", "0x60000000")
    assert said.startswith("bench: firmware fault: ")
    assert "at pc 0x08000026 in load" in said


def test_run(bench, file, out):
    """A run says how long it ran, at what clock, and where it stands; exit code 0."""
    said = bench("mcu", "run", file, "--until", 0.25, "--json", out)
    assert (said.code, said.err) == (0, "")
    result = json.loads(out.read_text())
    assert (result["ended"], result["fault"], result["sleeping"]) == ("time", None, True)
    assert result["seconds"] == pytest.approx(0.25)
    assert (result["hz"], result["wait_states"], result["cycles"]) == (16_000_000, 0, 4_000_000)
    assert result["frames"] == result["unmodelled"] == []
    assert "ran        0.250000 s, 4000000 cycles" in said.out
    assert "clock      16 MHz since 0.000000 s, flash at 0 wait states" in said.out
    assert "at the end asleep at pc 0x0800000e in reset" in said.out


def test_run_as_json_alone(bench, file):
    """With --json - the output is the document and nothing else."""
    assert json.loads(bench("mcu", "run", file, "--json", "-").out)["seconds"] == pytest.approx(1.0)


def test_run_of_a_stripped_file(bench, stripped):
    """A file without symbols runs, with a word on what is missing."""
    said = bench("mcu", "run", stripped, "--until", 0.001)
    assert said.code == 0
    assert said.err == f"bench: firmware: {stripped} has no symbols: addresses alone are shown\n"
    assert "asleep at pc 0x0800000e\n" in said.out


def test_run_traced(bench, file, tmp_path):
    """A trace shows each function as it is entered, with time and address, before the report or in a file."""
    said = bench("mcu", "run", file, "--until", 0.001, "--trace")
    lines = said.out.splitlines()
    assert [line.split()[1:] for line in lines[:2]] == [["0x08000008", "reset"], ["0x08000010", "count"]]
    assert float(lines[0].split()[0]) < float(lines[1].split()[0]) < 0.001
    assert lines[2].startswith(str(file))
    said = bench("mcu", "run", file, "--until", 0.001, "--trace-blocks", "--trace-out", tmp_path / "trace")
    assert said.out.startswith(str(file))
    blocks = [line.split()[1] for line in (tmp_path / "trace").read_text().splitlines()]
    assert blocks[:3] == ["0x08000008", "0x08000010", "0x0800000c"]


def test_run_that_faults(bench, tmp_path, out):
    """A fault ends the run with its report and exit code 2."""
    path = tmp_path / "bad.elf"
    path.write_bytes(
        elf(Part(".text", FLASH, vectors() + bytes.fromhex("00de")), symbols=(Symbol("f", FLASH + 9),))
    )
    said = bench("mcu", "run", path, "--json", out)
    assert said.code == 2
    assert "at the end ended by a fault, running at pc 0x08000008 in f" in said.out
    assert said.err.startswith("bench: firmware fault: ")
    assert json.loads(out.read_text())["ended"] == "fault"
    assert json.loads(out.read_text())["fault"] in said.err


def test_run_of_a_heartbeat(bench, out, arm_gcc):
    """Frames are listed by identifier, registers that are not modelled by name."""
    said = bench("mcu", "run", built("heart", "-O1", "-DBRP=6"), "--until", 0.1, "--json", out)
    assert said.code == 0
    result = json.loads(out.read_text())
    assert (result["hz"], result["wait_states"]) == (168_000_000, 5)
    assert 0.002 < result["hz_since_s"] < 0.003
    frames = [(row["id"], row["extended"], row["frames"]) for row in result["frames"]]
    assert frames == [(0x123, False, 8), (0x1234567, True, 2)]
    assert result["frames"][1]["period_ms"] == pytest.approx(40, abs=0.1)
    assert result["frames"][1]["last_data"] == "47a5"
    assert {"address": 0x40013008, "register": "SPI1_SR", "accesses": 2} in result["unmodelled"]
    assert "CAN        10 frames sent" in said.out
    assert "01234567       2" in said.out
    assert "0x40013000  SPI1_CR1          1 times" in said.out


def test_run_that_says_something(bench, out, arm_gcc):
    """What was written to USARTs and ITM is in the report, and with --usart shown as it comes."""
    elf_file = built("says", "-O1")
    said = bench("mcu", "run", elf_file, "--until", 0.01, "--json", out)
    assert said.code == 0
    result = json.loads(out.read_text())
    text = "hello, bench\nsecond line\n"
    assert result["text"] == {"USART2": text, "ITM": text}
    assert "  USART2     25 characters, the last lines:\n             hello, bench\n" in said.out
    assert result["without_clock"]
    assert all(
        f"clock off: {what}, {times} times" in said.out for what, times in result["without_clock"].items()
    )
    shown = bench("mcu", "run", elf_file, "--until", 0.01, "--usart").out
    assert shown.index("second line\n") < shown.index("on the emulated STM32F405")


def test_run_at_another_bit_rate(bench, arm_gcc):
    """A firmware set to another bit rate than the bus faults by name; told the right one it runs."""
    slow = built("heart", "-O1", "-DBRP=12")
    said = bench("mcu", "run", slow, "--until", 0.05)
    assert said.code == 2
    assert "250000 bit/s on a bus of 500000" in said.err
    assert bench("mcu", "run", slow, "--until", 0.05, "--bitrate", 250_000).code == 0


def test_run_on_a_live_bus(bench, arm_gcc, out):
    """On a live bus the frames reach others, in wall time."""
    with LiveBus("virtual:heart") as there:
        said = bench(
            *("mcu", "run", built("heart", "-O1", "-DBRP=6"), "--can", "virtual:heart"),
            *("--until", 0.2, "--json", out),
        )
        heard = there.receive(0.1)
    assert said.code == 0
    assert said.err == "on virtual:heart at 500000 bit/s; Ctrl-C ends it\n"
    assert heard.frame.id == 0x123
    assert sum(row["frames"] for row in json.loads(out.read_text())["frames"]) >= 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["INT", "TERM"])
def test_run_stopped(bench, file, out, monkeypatch, number):
    """Ctrl-C and SIGTERM end a run with its report and exit code 0."""

    def stopped(*_):
        os.kill(os.getpid(), number)

    monkeypatch.setattr(solo, "run", stopped)
    said = bench("mcu", "run", file, "--json", out)
    assert (said.code, said.err) == (0, "")
    assert "at the end interrupted, " in said.out
    assert json.loads(out.read_text())["ended"] == "interrupted"


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("--vectors", "there"), "bench: --vectors is there, which is no address"),
        (("--vectors", "0x08000200"), "firmware: FILE: no vector table at 0x08000200"),
        (("--until", "0"), "bench: --until is 0.0 s; it must be above 0, up to 1e6"),
        (("--until", "nan"), "bench: --until is nan s"),
        (("--bitrate", "0"), "bus: bit rate 0 bit/s is not within 1 to 1000000"),
        (("--can", "nothing:0"), "bus: nothing:0: no interface 'nothing'"),
        (("--trace-out", "/none/trace"), "record: /none/trace: no folder /none"),
        (("--json", "/none/out.json"), "record: /none/out.json: no folder /none"),
    ],
)
def test_run_refused(refused, file, words, complaint):
    """Bad input is one line and exit code 2."""
    assert refused("mcu", "run", file, *words).startswith(f"bench: {complaint}".replace("FILE", str(file)))


def test_run_without_a_vector_table(refused, tmp_path):
    """A file without a vector table cannot be run; where one seems to be is said."""
    path = tmp_path / "offset.elf"
    path.write_bytes(elf(Part(".text", FLASH + 0x4000, vectors(reset=FLASH + 0x4009) + bytes(8))))
    assert "there is one at 0x08004000 (--vectors 0x8004000)" in refused("mcu", "run", path)


def test_absent_file(refused, tmp_path):
    """A file that is not there is one line."""
    for command in (("run",), ("call",)):
        words = (*command, tmp_path / "none.elf", *(["f"] if command == ("call",) else []))
        assert (
            refused("mcu", *words) == f"bench: firmware: {tmp_path / 'none.elf'}: no such file or directory\n"
        )

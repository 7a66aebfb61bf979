"""What a debugger sees of the machine, and that looking does not change it."""

import pytest

from targets.ecu import Frame
from targets.emulated import EmulatedEcu
from targets.mcu.debugger import Debugger

MS = 1_000_000
SRAM = 0x20000000


@pytest.fixture
def probe(mcu_ecu):
    """A debugger on the IFD, in reset."""
    return Debugger(mcu_ecu.mcu)


def halt_at(probe: Debugger, address: int, until_ns: int = 0) -> None:
    """Run to a breakpoint at `address`, and remove it."""
    assert probe.insert("break", address, 2)
    probe.resume()
    probe.mcu.run(until_ns)
    assert probe.hit == ("break", address)
    assert probe.remove("break", address, 2)


def input_cycle(ecu: EmulatedEcu, k: int = 0) -> None:
    ecu.receive(Frame(0x100, bytes((0x00, 0x08, 0x80, k))), ecu.mcu.now_ns)
    ecu.receive(Frame(0x101, bytes((0, 0, 0x70, 0x17, k))), ecu.mcu.now_ns)


def test_breakpoint_halts_before_its_instruction(probe, image):
    """The program counter of a halt is the breakpoint's address, and the function has not begun."""
    halt_at(probe, image.symbol("main"))
    assert probe.registers()["pc"] == image.symbol("main")
    assert probe.read_memory(0x40023840, 4) == bytes(4)  # board_init has not switched a clock on


def test_nothing_is_written_into_the_program(probe, image):
    """Memory at a breakpoint reads as the program's own bytes."""
    main = image.symbol("main")
    before = probe.read_memory(main, 4)
    probe.insert("break", main, 2)
    assert probe.read_memory(main, 4) == before


def test_breakpoint_set_twice(probe, image):
    """A breakpoint that was set twice is there until it has been removed twice."""
    main = image.symbol("main")
    for _ in range(2):
        probe.insert("break", main, 2)
    assert probe.remove("break", main, 2)
    probe.resume()
    probe.mcu.run(0)
    assert probe.hit == ("break", main)
    assert probe.remove("break", main, 2)
    assert not probe.remove("break", main, 2)


def test_resuming_passes_the_breakpoint(probe, image):
    """A machine resumed at a breakpoint executes the instruction there, and halts when it comes back."""
    step = image.symbol("ecu_step")
    probe.mcu.patch(step, bytes.fromhex("fee7"))  # b .
    halt_at(probe, image.symbol("main"))
    probe.write_register("pc", step)
    probe.insert("break", step, 2)
    assert probe.hit
    probe.resume()
    assert not probe.hit
    cycles = probe.mcu.cycles
    probe.mcu.run(0)
    assert probe.hit == ("break", step)
    assert 0 < probe.mcu.cycles - cycles < 10


def test_bkpt_in_the_program(probe, image):
    """A BKPT instruction halts like a breakpoint, and the machine resumes behind it."""
    main = image.symbol("main")
    probe.mcu.patch(main, bytes.fromhex("00be" + "00be" + "fee7"))  # bkpt #0; bkpt #0; b .
    for address in (main, main + 2):
        probe.resume()
        probe.mcu.run(0)
        assert probe.hit == ("break", address)
    probe.resume()
    probe.mcu.run(0)
    assert probe.hit is None
    assert probe.mcu.pc == main + 4


def test_elsewhere_from_a_bkpt(probe, image):
    """A program counter that was set at a BKPT is where the machine resumes."""
    main = image.symbol("main")
    probe.mcu.patch(main, bytes.fromhex("00be" + "fee7" + "fee7"))  # bkpt #0; b .; b .
    probe.mcu.run(0)
    assert probe.hit
    probe.write_register("pc", main + 4)
    probe.resume()
    probe.mcu.run(0)
    assert probe.mcu.pc == main + 4


def test_breakpoint_after_wfi_waits_for_the_interrupt(mcu_ecu, image):
    """A core that sleeps before a breakpoint has not reached it."""
    probe = Debugger(mcu_ecu.mcu)
    mcu_ecu.advance(0)
    probe.insert("break", probe.mcu.pc, 2)
    probe.resume()
    probe.mcu.run(5 * MS)
    assert probe.hit is None
    input_cycle(mcu_ecu)
    probe.mcu.run(6 * MS)
    assert probe.hit == ("break", probe.mcu.pc)


def test_steps_follow_the_program(probe, image):
    """Every step moves on by an instruction of the disassembly, or to a branch's target."""
    import capstone

    engine = capstone.Cs(capstone.CS_ARCH_ARM, capstone.CS_MODE_THUMB | capstone.CS_MODE_MCLASS)
    halt_at(probe, image.symbol("main"))
    for _ in range(40):
        pc = probe.registers()["pc"]
        here = next(engine.disasm(probe.read_memory(pc, 4), pc))
        assert probe.step(0)
        now = probe.registers()["pc"]
        branches = here.mnemonic.startswith(("b", "cb", "pop"))
        assert branches or now == pc + here.size, f"{here.mnemonic} at {pc:#x} led to {now:#x}"


def test_a_sleeping_core_steps_when_it_wakes(mcu_ecu):
    """A step asleep waits for the instant it is given; with an interrupt pending it enters the handler."""
    probe = Debugger(mcu_ecu.mcu)
    mcu_ecu.advance(0)
    assert not probe.step(5 * MS)
    assert probe.now_ns >= 5 * MS
    input_cycle(mcu_ecu)
    assert probe.step(6 * MS)
    assert probe.now_ns < 6 * MS


@pytest.mark.parametrize("name", ["r0", "r12", "sp", "lr", "pc", "d0", "d15", "fpscr", "primask", "basepri"])
def test_registers_are_written(probe, name):
    """What is written to a register is read from it, and no other one changes but its alias."""
    before = probe.registers()
    value = {
        "d0": 0x400921FB54442D18,
        "d15": 0x3FF0000000000000,
        "fpscr": 0x80400000,
        "primask": 1,
        "basepri": 0x40,
    }.get(name, 0x08000100)
    probe.write_register(name, value)
    after = probe.registers()
    assert after[name] == value
    aliases = {"sp": {"msp"}, "d0": {"s0", "s1"}, "d15": {"s30", "s31"}}.get(name, set())
    assert {key for key in before if before[key] != after[key]} <= {name} | aliases


def test_memory_is_written(probe):
    """SRAM, core-coupled memory, flash and device registers are written, what is nowhere is refused."""
    for address in (SRAM + 3, 0x10000001, 0x08004001, 0x0800C000):
        assert probe.write_memory(address, b"\x12\x34\x56\x78\x9a")
        assert probe.read_memory(address, 5) == b"\x12\x34\x56\x78\x9a"
    assert probe.write_memory(0x40023830, b"\1\0\0\0")  # RCC_AHB1ENR: a clock for port A
    assert probe.write_memory(0x40020000, (0xAB).to_bytes(4, "little"))
    assert probe.read_memory(0x40020000, 4) == (0xAB).to_bytes(4, "little")
    assert not probe.write_memory(0x30000000, b"\0")
    assert not probe.write_memory(0xFFFFFFFF, b"\0\0")


def test_memory_is_read_as_far_as_it_goes(probe):
    """Reading over the end of SRAM gives what lies before it; past 4 GB there is nothing."""
    assert len(probe.read_memory(SRAM + 0x20000 - 3, 100)) == 3
    assert probe.read_memory(1 << 32, 4) == b""
    assert probe.read_memory(0x30000000, 4) == b""


@pytest.mark.parametrize("kind", ["write", "read", "access"])
def test_watchpoint_halts_after_the_access(mcu_ecu, image, kind):
    """The machine halts behind the instruction that accesses what is watched, and names the point."""
    probe = Debugger(mcu_ecu.mcu)
    mcu_ecu.advance(0)
    head = image.symbol("ring_head")
    # a byte inside the word that the program accesses
    assert probe.insert(kind, head + 1, 1)
    input_cycle(mcu_ecu)
    probe.resume()
    mcu_ecu.advance(MS)
    assert probe.hit == (kind, head + 1)
    assert probe.now_ns < MS
    assert probe.read_memory(head, 4) == (1 if kind == "write" else 0).to_bytes(4, "little")
    assert probe.remove(kind, head + 1, 1)
    probe.resume()
    mcu_ecu.advance(MS)
    assert probe.hit is None


def test_watchpoint_next_to_an_access(mcu_ecu, image):
    """Accesses that end before what is watched halt nothing."""
    probe = Debugger(mcu_ecu.mcu)
    mcu_ecu.advance(0)
    lost = image.symbol("ring_lost")  # behind head and tail, and never written here
    assert probe.insert("write", lost, 4)
    input_cycle(mcu_ecu)
    probe.resume()
    assert mcu_ecu.advance(MS)
    assert probe.hit is None


@pytest.mark.parametrize("address", [0x40020000, 0xE000E100, 0x30000000, 0x1_0000_0000])
def test_watchpoint_that_cannot_be(probe, address):
    """Devices and what is nowhere cannot be watched."""
    assert not probe.insert("write", address, 4)
    assert not probe.remove("write", address, 4)


def answers(image, calibration, look) -> list:
    """The first transmissions of an ECU that is halted and looked at wherever `look` sets a breakpoint."""
    ecu = EmulatedEcu(image, calibration)
    probe = Debugger(ecu.mcu)
    look(probe)
    ecu.advance(0)
    sent = []
    for k in range(3):
        input_cycle(ecu, k)
        until = (10 * k + 8) * MS
        while ecu.mcu.now_ns < until:
            probe.resume()
            request = ecu.advance(until)
            if request:
                sent.append(request)
                ecu.sent(request.handle, request.t_ns)
            if probe.hit:
                for _ in range(5):
                    probe.registers()
                    probe.step(until)
                probe.read_memory(SRAM, 64)
    assert len(sent) == 6
    return sent


def test_looking_changes_nothing(image, calibration):
    """Breakpoints, steps and a look at the registers change no frame, and its instant by 2 us at most."""

    def breaks(probe: Debugger) -> None:
        for name in ("narx_step", "ecu_status", "can1_rx0_handler", "tanh"):
            if name in image.symbols:
                probe.insert("break", image.symbol(name), 2)

    plain = answers(image, calibration, lambda probe: None)
    debugged = answers(image, calibration, breaks)
    assert [t.frame for t in plain][::2] == [t.frame for t in debugged][::2]
    assert max(abs(a.t_ns - b.t_ns) for a, b in zip(plain, debugged, strict=True)) <= 2000


def test_reports(mcu_ecu):
    """The reports say what the machine is: its time, clock, cycles, CAN controllers, unmodelled registers."""
    probe = Debugger(mcu_ecu.mcu)
    assert probe.reports["can"]().splitlines() == ["CAN1: without a clock", "CAN2: without a clock"]
    mcu_ecu.advance(0)
    assert probe.reports["time"]() == f"{mcu_ecu.mcu.now_ns / 1e9:.9f} s"
    assert probe.reports["cycles"]().endswith("cycles, now at 22 MHz")
    assert "CAN1: normal; a bit is 22 quanta of 2 APB1 clocks; 0 frames to send" in probe.reports["can"]()
    assert probe.reports["unmodelled"]() == "no unmodelled register was accessed"
    probe.write_memory(0x40010000, bytes(4))
    assert probe.reports["unmodelled"]().endswith("0x40010000  1")

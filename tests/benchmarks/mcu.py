"""How fast the emulated MCU is: beside itself without the cycle model, beside QEMU, and as an ECU on the bus.

python -m tests.benchmarks.mcu [REPEAT]

Every figure is CPU time of the process that computes, the median of REPEAT rounds, of the loop five times as
many, in which all take their turn; what is added to the time of the deadlines is the median of each round's
ratio. The program is the shipped IFD image: once its own start-up code has run, `ecu_step` is called again
and again from a loop of five instructions in SRAM, on every machine by the same debugger's requests. On the
bus 1 kHz is more than the protocol was made for: an answer may come after the next cycle has begun, so
nothing is judged late.
"""

import os
import struct
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import unicorn
from numba import carray, types

from bench.codec import Codec
from bench.gdb.session import Onlooker
from bench.mdlog.logger import Schedule, schedule
from bench.rig import ride
from bench.sensors.codes import acquire
from targets.ecus import build
from targets.emulated import EmulatedEcu
from targets.firmware import ELF
from targets.jit import cfunc
from targets.mcu import blocks, machine, native
from targets.mcu.image import load
from targets.mcu.machine import Stm32f405
from targets.mcu.state import CYCLES, DEADLINE, PC, SIZE, STOPPED
from tests.conftest import wavy_lap
from tests.targets.mcu import qemu
from tests.targets.mcu.rsp import Client, connect

STEPS, QEMU_STEPS, COUNTED = 10_000, 50_000, 20
"""Calls in a run; QEMU's CPU time comes in hundredths of a second."""

ROUNDS = 5
RIDE_S = 30.0
INPUTS = ("fork_stroke_mm", "rear_stroke_mm", "pitch_rate_dps", "speed_kmh")
BITRATE = 500_000

LOOP, END = 0x20010000, 0x20012000
"""Two pages of SRAM: QEMU runs the one with a breakpoint in it an instruction at a time."""

RAM, RAM_SIZE, PAGE, CPACR = 0x20000000, 0x4000, 0x400, 0xE000ED88

# loop: mov r0, r4; blx r5; subs r6, #1; bne loop; bx r7
LOOP_CODE = bytes.fromhex("2046 a847 013e fbd1 3847")
END_CODE = bytes.fromhex("fee7")  # b .


@cfunc(types.void(types.voidptr, types.uint64, types.uint32, types.voidptr))
def deadline_only(engine: Any, address: int, size: int, user: Any) -> None:
    """What is left of the block hook without the cycle model: looking at the deadline."""
    S = carray(user, (SIZE,), types.int64)
    if S[CYCLES] >= S[DEADLINE]:
        S[STOPPED] = blocks.AT_BLOCK
        S[PC] = types.int64(address)
        native.stop(S)


@contextmanager
def block_hook(callback: int | None) -> Iterator[None]:
    """Machines built meanwhile have `callback` for a block hook; None: they have none."""
    plain = machine._hook

    def hook(uc: Any, kind: int, given: int, *more: Any) -> int:
        if kind != unicorn.UC_HOOK_BLOCK:
            return plain(uc, kind, given, *more)
        return plain(uc, kind, callback, *more) if callback else 0

    machine._hook = hook
    try:
        yield
    finally:
        machine._hook = plain


class Loop:
    """The image behind `client`, about to call `ecu_step` as often as asked.

    booted: a machine whose start-up is over, to take the memory of; a clock that stands still starts nothing.
    """

    def __init__(self, client: Client, cpu_s: Callable[[], float], booted: Stm32f405 | None = None) -> None:
        self.client, self._cpu_s = client, cpu_s
        made = build()
        symbol = made.image.symbol
        state, back = symbol("state"), symbol("main")
        if booted:
            for at in range(RAM, RAM + RAM_SIZE, PAGE):
                client.write(at, booted.read_bytes(at, PAGE))
            client.write(CPACR, struct.pack("<I", 0xF << 20))  # the FPU is on
        else:
            client.run_to(back)
        client.write(symbol("calibration_image"), made.calibration.image())
        arguments = (state, symbol("calibration_image"), symbol("calibration_room"), 0)
        assert client.call(symbol("ecu_init"), *arguments, back=back) == 0
        for k, data in enumerate((bytes((0x00, 0x08, 0x80, 0)), bytes((0, 0, 0x70, 0x17, 0)))):
            client.write(END + 0x1000, struct.pack("<II8s", 0x100 + k, len(data), data))
            assert client.call(symbol("ecu_receive"), state, END + 0x1000, back=back) == k
        client.do(b"z1,%x,2" % back)
        client.write(LOOP, LOOP_CODE)
        client.write(END, END_CODE)
        for number, value in ((4, state), (5, symbol("ecu_step") | 1), (7, END | 1)):
            client.set_register(number, value)
        self.run(300)  # past the detector's warm-up, and everything translated

    def run(self, steps: int) -> float:
        """CPU seconds of `steps` calls."""
        self.client.set_register(6, steps)
        self.client.set_register(15, LOOP)
        begun = self._cpu_s()
        self.client.run_to(END)
        return self._cpu_s() - begun


def ours(callback: int | None) -> Loop:
    """The loop on our machine with `callback` for a block hook."""
    booted = Stm32f405(load(ELF["ifd"]))
    connect(booted).run_to(booted.image.symbol("main"))
    with block_hook(callback):
        return Loop(connect(Stm32f405(load(ELF["ifd"]))), time.process_time, booted)


def theirs(process: int, client: Client) -> Loop:
    """The loop on QEMU."""
    tick = os.sysconf("SC_CLK_TCK")

    def cpu_s() -> float:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / tick  # user and system time

    return Loop(client, cpu_s)


def instructions_per_step() -> float:
    """Of the loop, by the engine's own hook on every instruction."""
    mcu = Stm32f405(load(ELF["ifd"]))
    loop, count = Loop(connect(mcu), time.process_time), 0

    def on_instruction(*_: Any) -> None:
        nonlocal count
        count += 1

    mcu._engine.hook_add(unicorn.UC_HOOK_CODE, on_instruction)
    mcu._engine.ctl_flush_tb()
    loop.run(COUNTED)
    return count / COUNTED


def frames(rate: int) -> Schedule:
    """The lap's frames, `rate` input cycles a second: those of 100 Hz, closer together."""
    lap = wavy_lap(RIDE_S * rate / 100, INPUTS)
    slow = schedule(acquire(lap), Codec())
    return replace(slow, t_ns=slow.t_ns * 100 // rate)


def on_the_bus(sent: Schedule) -> tuple[float, str]:
    """Emulated seconds a CPU second of a ride, emulator, bus and bench together; what the bus carried."""
    made = build()
    ecu = EmulatedEcu(made.image, made.calibration)
    watch = Onlooker(Codec())
    begun = time.process_time()
    done = ride(sent, ecu, watch, BITRATE)
    spent = time.process_time() - begun
    if done.failure:
        raise SystemExit(done.failure)
    carried = f"{watch.answered} of {watch.cycles} cycles answered, bus load {done.load.load:.0%}"
    return done.end_ns / 1e9 / spent, carried


def median(values: list[float]) -> float:
    """The middle one."""
    return sorted(values)[len(values) // 2]


def main() -> None:
    """Measure in turn, and print."""
    repeat = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    print(f"load of this machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} CPUs")
    per_step = instructions_per_step()
    rides = {f"IFD at {rate} Hz": frames(rate) for rate in (100, 1000)}
    with ExitStack() as stack:
        model, deadline = ours(blocks.on_block.address), ours(deadline_only.address)
        loops = {"with the cycle model": model, "deadlines only": deadline, "engine alone": ours(None)}
        if qemu.installed():
            running = stack.enter_context(qemu.started(ELF["ifd"]))
            loops[qemu.PROGRAM] = theirs(running.process.pid, running.client)
        else:
            print(f"no {qemu.PROGRAM} on this machine")
        mips: dict[str, list[float]] = {name: [] for name in loops}
        for _ in range(repeat * ROUNDS):
            for name, loop in loops.items():
                steps = QEMU_STEPS if name == qemu.PROGRAM else STEPS
                mips[name].append(per_step * steps / loop.run(steps) / 1e6)
        speed: dict[str, list[float]] = {name: [] for name in rides}
        carried: dict[str, str] = {}
        for _ in range(repeat):
            for name, sent in rides.items():
                ratio, carried[name] = on_the_bus(sent)
                speed[name].append(ratio)
    print(f"\necu_step, {per_step:.0f} instructions a call; MIPS, the best, time added to the deadlines'")
    for name, rates in mips.items():
        added = median([plain / rate for plain, rate in zip(mips["deadlines only"], rates, strict=True)]) - 1
        print(f"  {name:22} {median(rates):6.0f} {max(rates):6.0f} {added:+7.1%}")
    print(f"\non a bus of {BITRATE // 1000} kbit/s, {RIDE_S:.0f} s; emulator, bus and bench in one process")
    for name, ratios in speed.items():
        print(
            f"  {name:22} {median(ratios):7.1f} emulated s a CPU s  ({min(ratios):.1f} to {max(ratios):.1f})"
        )


if __name__ == "__main__":
    main()

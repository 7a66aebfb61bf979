"""The shipped firmware on QEMU and on our machine: the same outputs from the same number of instructions.

QEMU's STM32F405 has no bxCAN and no oscillators, so the program as a whole does not get past its start-up
there. Its reset handler does, and after that each function of the application is called in place, in the
unmodified image, on both machines, by the same debugger's requests. An instruction that an IT block skips
counts as one, on both.
"""

import struct
from functools import cache
from itertools import groupby

import pytest

from bench.codec import Codec
from bench.laps.lap import Lap
from bench.mdlog.logger import schedule
from bench.sensors.codes import acquire
from targets.calibration import load as load_calibration
from targets.ecus import CALIBRATIONS
from targets.firmware import ELF
from targets.mcu.image import Image, load
from targets.mcu.machine import Stm32f405
from tests.conftest import wavy_lap
from tests.targets.mcu import qemu
from tests.targets.mcu.rsp import connect

pytestmark = [
    pytest.mark.qemu,
    pytest.mark.skipif(not qemu.installed(), reason=f"no {qemu.PROGRAM}: apt-get install qemu-system-arm"),
]

ROLES = {"ifd": 0, "soft_sensor": 1}
CYCLES, SHORTED_AT = 80, 55
FRAME = 0x20010000
"""Where frames are handed over: SRAM that the program does not use."""


class Ours:
    """Our machine behind our own debug stub, counting the instructions of the blocks it executes."""

    def __init__(self, image: Image) -> None:
        import capstone
        import unicorn

        self._mcu = Stm32f405(image)
        self.client = connect(self._mcu)
        self._count = 0
        self._block = (0, 0)
        engine = capstone.Cs(capstone.CS_ARCH_ARM, capstone.CS_MODE_THUMB | capstone.CS_MODE_MCLASS)

        @cache
        def length(address: int, size: int) -> int:
            return sum(1 for _ in engine.disasm_lite(self._mcu.read_memory(address, size), address))

        def on_block(uc: object, address: int, size: int, user: object) -> None:
            self._block = (address, length(address, size))
            self._count += self._block[1]

        self._mcu._engine.hook_add(unicorn.UC_HOOK_BLOCK, on_block)

    def instructions(self) -> int:
        """Instructions executed so far; the machine has halted before a block it had already entered."""
        assert self._block[0] == self._mcu.pc
        self._count -= self._block[1]
        self._block = (self._mcu.pc, 0)
        return self._count


def cycles_of_frames() -> list[list[bytes]]:
    """Input cycles of a lap as the program takes its frames; late the rear stroke sensor is shorted."""
    lap = wavy_lap(CYCLES / 100)
    rear = lap.channels["rear_stroke_mm"].copy()
    rear[10 * SHORTED_AT :] = 0.0
    frames = schedule(acquire(Lap(lap.t_ns, {**lap.channels, "rear_stroke_mm": rear})), Codec())
    return [
        [struct.pack("<II8s", frame.id, len(frame.data), frame.data) for _, frame in group]
        for _, group in groupby(frames, key=lambda row: row[0])
    ]


def ridden(machine: Ours | qemu.Qemu, image: Image, role: str, calibration: bytes) -> dict[str, list]:
    """What every call of a ride returned or wrote, and how many instructions it took, by function."""
    client, state, back = machine.client, image.symbol("state"), image.symbol("main")
    seen: dict[str, list] = {}

    def call(name: str, *arguments: int, writes: bool = False) -> int:
        before = machine.instructions()
        result = client.call(image.symbol(name), *arguments, back=back)
        output = client.read(FRAME, 16) if writes else result
        seen.setdefault(name, []).append((output, machine.instructions() - before))
        return result

    # Its own start-up code switches the FPU on, and clears and fills memory.
    client.run_to(back)
    client.write(image.symbol("calibration_image"), calibration)
    room = image.symbol("calibration_room")
    assert call("ecu_init", state, image.symbol("calibration_image"), room, ROLES[role]) == 0
    for frames in cycles_of_frames():
        for frame in frames:
            client.write(FRAME, frame)
            if call("ecu_receive", state, FRAME):
                seen.setdefault("ecu_step", [])
                before = machine.instructions()
                client.call(image.symbol("ecu_step"), state, back=back)
                seen["ecu_step"].append(machine.instructions() - before)
                call("ecu_status", state, FRAME, writes=True)
                call("ecu_timing", state, 1234, FRAME, writes=True)
    seen["memory"] = [client.read(state, image.symbol("bss_end") - state)]
    return seen


@pytest.mark.parametrize(
    ("role", "calibration"),
    [("ifd", "gsxr1000"), ("ifd", "gsxr1000_checks"), ("soft_sensor", "gsxr1000")],
)
def test_same_outputs_from_as_many_instructions(role, calibration):
    """Eighty input cycles give the same frames and memory, bit for bit, and every call the same count."""
    image = load(ELF[role])
    content = load_calibration(CALIBRATIONS / f"{calibration}.json").with_detector(warmup=10).image()
    with qemu.started(ELF[role], *qemu.COUNTING) as theirs:
        expected = ridden(theirs, image, role, content)
    assert len({output for output, _ in expected["ecu_status"]}) == len(expected["ecu_step"]) == CYCLES
    if role == "ifd":  # the alarm comes, so that the decision is among what was compared
        alarms = [Codec().decode("IFD_STATUS", output[8:])["alarm"] for output, _ in expected["ecu_status"]]
        assert alarms[0] == 0
        assert alarms[-1] == 1
    assert ridden(Ours(image), image, role, content) == expected


def test_qemu_counts_instructions(image):
    """What we read of QEMU's virtual time is the number of steps a debugger takes through the same code."""
    with qemu.started(ELF["ifd"], *qemu.COUNTING) as theirs:
        client, back = theirs.client, image.symbol("main")
        client.run_to(back)
        client.set_register(14, back | 1)
        client.set_register(15, image.symbol("memset"))
        for number, argument in enumerate((FRAME, 0x55, 40)):
            client.set_register(number, argument)
        before, steps = theirs.instructions(), 0
        while client.register(15) != back:
            client.ask(b"vCont;s:1")
            steps += 1
        assert theirs.instructions() - before == steps
        assert client.read(FRAME, 40) == 40 * b"\x55"

"""The shipped firmware on the emulated MCU: boots, sleeps, is interrupted, takes time, fails by name."""

import numpy as np
import pytest

from targets.ecu import Frame
from targets.emulated import EmulatedEcu
from targets.errors import FirmwareFault
from targets.mcu import core, exceptions, native, state
from targets.mcu.image import FLASH
from targets.mcu.machine import TIME, Stm32f405

MS = 1_000_000


@pytest.fixture
def booted(mcu_ecu):
    """The IFD, a hundred milliseconds after power-on."""
    assert mcu_ecu.advance(0) is None
    return mcu_ecu


def strokes(alive: int) -> Frame:
    return Frame(0x100, bytes((0x00, 0x08, 0x80, alive)))


def motion(alive: int) -> Frame:
    return Frame(0x101, bytes((0, 0, 0x70, 0x17, alive)))


def cycle(ecu, k: int) -> list:
    """One input cycle at k * 10 ms; the transmissions it led to."""
    t_ns = 10 * MS * k
    ecu.advance(t_ns)
    for number, frame in enumerate((strokes(k & 15), motion(k & 15))):
        ecu.advance(t_ns + (number + 1) * 200_000)
        ecu.receive(frame, t_ns + (number + 1) * 200_000)
    sent = []
    while (request := ecu.advance(t_ns + 8 * MS)) is not None:
        sent.append(request)
        ecu.sent(request.handle, request.t_ns)
    return sent


def test_boots_to_sleep_at_22_mhz(booted):
    """Reset vector, PLL and bxCAN set-up lead to WFI, in normal mode, touching nothing unmodelled."""
    mcu = booted.mcu
    assert mcu.hz == 22_000_000
    assert mcu.state[state.SLEEPING] == 1
    assert mcu.image.function_at(mcu.pc) in ("main", "sleep_until_frame")
    assert mcu.unmodelled() == {}


def test_sleep_costs_no_emulation(booted):
    """Idle time passes without executing code."""
    before = int(booted.mcu.state[state.INSTRUCTIONS])
    assert booted.advance(3_600_000 * MS) is None
    assert int(booted.mcu.state[state.INSTRUCTIONS]) == before
    assert booted.mcu.now_ns >= 3_600_000 * MS


def test_answers_a_complete_cycle_only(booted):
    """Strokes alone are no input cycle; with the motion frame of the same count the ECU answers twice."""
    booted.receive(strokes(0), 0)
    assert booted.advance(5 * MS) is None
    booted.receive(motion(0), 5 * MS)
    first = booted.advance(9 * MS)
    second = booted.advance(9 * MS)
    assert [t.frame.id for t in (first, second)] == [0x200, 0x201]
    assert 5 * MS < first.t_ns < second.t_ns < 6 * MS


def test_step_cycles_are_of_the_right_size(booted):
    """The step the firmware times itself takes thousands of cycles and varies little."""
    cycles = [int.from_bytes(cycle(booted, k)[1].frame.data[:4], "little") for k in range(20)]
    assert min(cycles) > 3_000
    assert max(cycles) < 8_000
    assert np.std(cycles[1:]) < 200


def test_acceleration_frames_do_not_wake_it(booted):
    """The filters keep out what the network does not use."""
    before = int(booted.mcu.state[state.INSTRUCTIONS])
    booted.receive(Frame(0x102, bytes(5)), 0)
    booted.advance(5 * MS)
    assert int(booted.mcu.state[state.INSTRUCTIONS]) == before
    assert booted.mcu.state[state.CAN_LOST] == 1


def test_runs_are_reproducible(image, calibration):
    """Two power-ons with the same frames send the same bytes at the same nanoseconds."""

    def sent():
        ecu = EmulatedEcu(image, calibration)
        ecu.advance(0)
        return [t for k in range(30) for t in cycle(ecu, k)]

    assert sent() == sent()


def test_flipped_weight_in_flash_changes_predictions(image, calibration):
    """Predictions come from the weights in flash: one byte flipped there while it runs changes them."""
    intact, tampered = EmulatedEcu(image, calibration), EmulatedEcu(image, calibration)
    for ecu in (intact, tampered):
        ecu.advance(0)
    before = [(cycle(intact, k)[0].frame, cycle(tampered, k)[0].frame) for k in range(10)]
    # The last byte of the first output weight: its exponent.
    weights = len(calibration.image()) - 4 * calibration.network.neurons
    tampered.mcu.flash[tampered.calibration_at + weights + 3] ^= 1
    after = [(cycle(intact, k)[0].frame, cycle(tampered, k)[0].frame) for k in range(10, 20)]
    assert all(a == b for a, b in before)
    assert all(a != b for a, b in after)


def test_damaged_calibration_keeps_it_off_the_bus(image, calibration):
    """With a calibration whose checksum is wrong at boot the ECU stays silent and says where it stands."""
    ecu = EmulatedEcu(image, calibration)
    ecu.mcu.flash[ecu.calibration_at + 100] ^= 1
    ecu.advance(0)
    assert cycle(ecu, 0) == []
    assert "calibration_refused" in ecu.where()


def test_interrupt_keeps_the_registers_of_what_it_interrupts(booted, image, calibration):
    """A frame that arrives in the middle of a step changes its time, not its result."""
    quiet = EmulatedEcu(image, calibration)
    quiet.advance(0)
    for k in range(5):
        undisturbed = cycle(quiet, k)
        t_ns = 10 * MS * k
        booted.advance(t_ns)
        booted.receive(strokes(k & 15), t_ns)
        booted.advance(t_ns + 100_000)
        booted.receive(motion(k & 15), t_ns + 100_000)
        # 150 us later the network is being computed: a repeated frame interrupts it.
        booted.advance(t_ns + 250_000)
        booted.receive(motion(k & 15), t_ns + 250_000)
        disturbed = []
        while (request := booted.advance(t_ns + 8 * MS)) is not None:
            disturbed.append(request)
            booted.sent(request.handle, request.t_ns)
        assert disturbed[0].frame == undisturbed[0].frame
        slower, plain = (
            int.from_bytes(answers[1].frame.data[:4], "little") for answers in (disturbed, undisturbed)
        )
        assert slower > plain


def poke(ecu, address: int, code: bytes) -> None:
    """Put code where the program will run next, before it has been translated."""
    ecu.mcu.flash[address - FLASH :][: len(code)] = np.frombuffer(code, dtype=np.uint8)


def test_endless_loop_stops_at_the_deadline(image, calibration):
    """A firmware that never sleeps still hands back control at the instant asked for."""
    ecu = EmulatedEcu(image, calibration)
    step = image.symbol("ecu_step")
    poke(ecu, step, bytes.fromhex("fee7"))  # b .
    ecu.advance(0)
    assert cycle(ecu, 0) == []
    assert ecu.mcu.pc == step
    assert "in ecu_step" in ecu.where()
    assert abs(ecu.mcu.now_ns - 8 * MS) < 1000


@pytest.mark.parametrize(
    ("code", "complaint"),
    [
        ("00de", "undefined instruction"),  # udf #0
        ("00df", "SVCall, whose handler is an endless loop"),  # svc #0
        ("4ff09040" + "0060", "write"),  # mov r0, #0x48000000; str r0, [r0]
        ("4ff09040" + "0068", "read"),  # mov r0, #0x48000000; ldr r0, [r0]
        ("4ff09040" + "0047", "ARM state"),  # mov r0, #0x48000000; bx r0
        ("4ff09040" + "40f00100" + "0047", "region that holds no code"),  # ...; orr r0, #1; bx r0
        ("4ff04050" + "40f00100" + "0047", "fetch outside memory"),  # mov r0, #0x30000000; ...
    ],
    ids=["undefined", "svc", "store-unmapped", "load-unmapped", "jump-even", "jump-device", "jump-unmapped"],
)
def test_fatal_instructions_are_named_with_the_program_counter(image, calibration, code, complaint):
    """What only a fault handler could answer raises FirmwareFault with pc and function."""
    ecu = EmulatedEcu(image, calibration)
    poke(ecu, image.symbol("ecu_step"), bytes.fromhex(code))
    ecu.advance(0)
    with pytest.raises(FirmwareFault, match=complaint) as caught:
        cycle(ecu, 0)
    assert "at pc 0x" in str(caught.value)
    assert caught.value.function == "ecu_step" or caught.value.pc in (0x48000000, 0x30000000)


def test_bit_rate_of_the_bus_is_checked(image, calibration):
    """An ECU whose bit timing does not fit the bus is a fault with both rates named."""
    ecu = EmulatedEcu(image, calibration, bitrate=250_000)
    ecu.advance(0)
    with pytest.raises(FirmwareFault, match=r"500000 bit/s on a bus of 250000"):
        ecu.receive(strokes(0), 0)


def test_unmodelled_register_is_counted(image):
    """Access to what is not modelled reads as zero and is counted by address."""
    mcu = Stm32f405(image)
    from targets.mcu.peripherals import load, store

    assert load(mcu.state, 0x40010000, 4) == 0
    store(mcu.state, 0x40010000, 4, 1)
    store(mcu.state, 0x40010004, 4, 1)
    assert mcu.unmodelled() == {0x40010000: 2, 0x40010004: 1}


def test_half_word_write_leaves_the_other_half(image):
    """A narrow write to a register changes only the bytes it names."""
    from targets.mcu.peripherals import load, store

    mcu = Stm32f405(image)
    store(mcu.state, 0x40023830, 4, 1)  # GPIOA's clock
    store(mcu.state, 0x40020000, 4, 0x12345678)
    store(mcu.state, 0x40020002, 2, 0xABCD)
    store(mcu.state, 0x40020000, 1, 0xEF)
    assert load(mcu.state, 0x40020000, 4) == 0xABCD56EF


def test_cycle_counter_counts_while_enabled(image):
    """DWT's CYCCNT follows the CPU's cycles between enabling and disabling."""
    from targets.mcu import scs

    S = Stm32f405(image).state
    S[state.CYCLES] = 1000
    scs.write(S, 0xE0001004, 0)
    scs.write(S, 0xE0001000, 1)
    S[state.CYCLES] = 1500
    assert scs.read(S, 0xE0001004) == 500
    scs.write(S, 0xE0001000, 0)
    S[state.CYCLES] = 9999
    assert scs.read(S, 0xE0001004) == 500


def test_exception_frame_holds_what_the_architecture_says(image):
    """Entry stacks R0-R3, R12, LR, PC and xPSR, aligns the stack, and return restores them (B1.5.6)."""
    mcu = Stm32f405(image)
    S = mcu.state
    native.set_register(S, core.REG_SP, 0x20001004)
    for k in range(4):
        native.set_register(S, core.REG_R0 + k, 0x11 * (k + 1))
    S[state.PC] = 0x08000100
    exceptions.enter(S, 16 + 20)
    sp = native.get_register(S, core.REG_SP)
    assert sp % 8 == 0
    assert [mcu.read_word(sp + 4 * k) for k in range(4)] == [0x11, 0x22, 0x33, 0x44]
    assert mcu.read_word(sp + 24) == 0x08000100
    assert native.get_register(S, core.REG_LR) == 0xFFFFFFF9
    assert mcu.image.function_at(mcu.pc) == "can1_rx0_handler"
    native.set_register(S, core.REG_R0, 0)
    S[state.PC] = 0xFFFFFFF8
    exceptions.leave(S)
    assert native.get_register(S, core.REG_SP) == 0x20001004
    assert native.get_register(S, core.REG_R0) == 0x11
    assert S[state.PC] == 0x08000100


def test_time_may_be_asked_in_the_past(image):
    """Asking for an instant already reached runs nothing."""
    mcu = Stm32f405(image)
    mcu.run(1000)
    before = mcu.cycles
    assert mcu.run(0) == TIME
    assert mcu.cycles == before

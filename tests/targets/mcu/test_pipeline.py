"""What instructions cost together: the manual's rules, published measurements of single effects."""

import numpy as np
import pytest

from targets.mcu import pipeline, state
from targets.mcu.decode import decode
from targets.mcu.timing import timing

ORIGIN = 0x08000100
MODEL, OPTIMISTIC, PESSIMISTIC = range(3)


class Core:
    """Straight pieces of hand-assembled Thumb code, one after the other at ORIGIN."""

    def __init__(self, code: str) -> None:
        data = bytes.fromhex(code)
        self.end = ORIGIN + len(data)
        self.S = state.allocate()
        figures = timing().pipeline
        self.S[state.PIPELINE : state.PIPELINE + figures.size] = figures.ravel()
        rows = decode(data, ORIGIN)
        at = pipeline.row(ORIGIN)
        self.S[at : at + rows.size] = rows.ravel()
        self.state = pipeline.ENTRY

    def run(self, start: int = ORIGIN, end: int = 0, taken: bool = True, figures: int = MODEL) -> int:
        """Cycles from `start` to `end`, in the state that the piece before left."""
        spent = pipeline.simulate(
            self.S, figures, *self.state, start, end or self.end, taken, pipeline.NOWHERE
        )
        self.state = tuple(int(self.S[state.RESULT + k]) for k in range(3))
        return int(spent)


def total(code: str, figures: int = MODEL) -> int:
    """Cycles of code given as hexadecimal bytes, entered with nothing in flight."""
    return Core(code).run(figures=figures)


@pytest.mark.parametrize(
    ("code", "cycles"),
    [
        ("0130", 1),  # adds r0, #1
        ("00fb01f0", 1),  # mul r0, r0, r1
        ("00fb0120", 1),  # mla r0, r0, r1, r2
        ("e2fb6301", 1),  # umaal r0, r6, r2, r3
        ("21fb0230", 1),  # smlad r0, r1, r2, r3
        ("0868", 2),  # ldr r0, [r1]
        ("0860", 1),  # str r0, [r1]
        ("8850", 2),  # str r0, [r1, r2]
        ("c2e90001", 3),  # strd r0, r1, [r2]
        ("d2e90001", 3),  # ldrd r0, r1, [r2]
        ("0fb4", 5),  # push {r0-r3}
        ("0dc9", 4),  # ldm r1!, {r0, r2, r3}
        ("00ee101a", 1),  # vmov s0, r1
        ("42ec101b", 2),  # vmov d0, r1, r2
        ("30ee201a", 1),  # vadd.f32 s2, s0, s1
        ("a0ee201a", 3),  # vfma.f32 s2, s0, s1
        ("91ed000a", 2),  # vldr s0, [r1]
        ("91ed000b", 3),  # vldr d0, [r1]
        ("b1ec040a", 5),  # vldmia r1!, {s0-s3}
        ("eff31080", 2),  # mrs r0, primask
    ],
)
def test_single_instruction(code, cycles):
    """An instruction by itself costs what the technical reference manual says (tables 3-1 and 7-1)."""
    assert total(code) == cycles


@pytest.mark.parametrize(
    ("code", "cycles"),
    [
        ("08684a68", 3),  # ldr r0, [r1]; ldr r2, [r1, #4]
        ("08684a688b68", 4),  # three loads
        ("88589950", 3),  # ldr r0, [r1, r2]; str r1, [r3, r2]
        ("08680268", 4),  # ldr r0, [r1]; ldr r2, [r0]: the address is waited for
        ("08684a60", 2),  # ldr r0, [r1]; str r2, [r1, #4]
        ("08604a60", 2),  # two stores
        ("08604a68", 4),  # str r0, [r1]; ldr r2, [r1, #4]: a store holds up a load
        ("086093e81400", 5),  # str r0, [r1]; ldm r3, {r2, r4}
        ("086800bf", 2),  # ldr r0, [r1]; nop: hidden behind the load
        ("08689a42", 3),  # ldr r0, [r1]; cmp r2, r3: not hidden
        ("885000bf", 2),  # str r0, [r1, r2]; nop
        ("04310868", 4),  # adds r1, #4; ldr r0, [r1]: an address is needed a cycle early
        ("043101320868", 4),  # adds r1, #4; adds r2, #1; ldr r0, [r1]
        ("51f8040b51f8042b", 4),  # ldr r0, [r1], #4; ldr r2, [r1], #4
        ("51f8040b53f8042b", 3),  # ldr r0, [r1], #4; ldr r2, [r3], #4
    ],
)
def test_memory_pairs(code, cycles):
    """Loads and stores overlap as section 3.3.3 and measurements on an STM32F407 say."""
    assert total(code) == cycles


@pytest.mark.parametrize(
    ("code", "cycles"),
    [
        ("30ee201a33eea43a", 2),  # vadd s2, s0, s1; vadd s6, s7, s9
        ("30ee201a31ee203a", 3),  # vadd s2, s0, s1; vadd s6, s2, s1: the result a cycle later
        ("00ee201a01ee821a", 6),  # vmla s2, s0, s1; vmla s2, s3, s4: the addend is taken a cycle later
        ("80ee201a72ee221a", 15),  # vdiv s2, s0, s1; vadd s3, s4, s5: the unit is busy
        ("80ee201a01300130", 3),  # vdiv s2, s0, s1; adds r0, #1; adds r0, #1: the core is not
    ],
)
def test_float_pairs(code, cycles):
    """FP results, multiply-accumulates and divisions delay what needs them, nothing else (section 7.2.3)."""
    assert total(code) == cycles


def test_it_folds_behind_a_narrow_instruction():
    """IT after a 16-bit instruction takes no cycle, after a 32-bit one it takes one."""
    assert total("012008bf0121") == 2  # movs r0, #1; it eq; moveq r1, #1
    assert total("4ff0010008bf0121") == 3  # mov.w r0, #1; it eq; moveq r1, #1


WIDE = "4fea0808"  # mov.w r8, r8
AFTER_BRANCH = (1 << 41 | 14 << 27, 0, 0)
"""A state that ended with a direct branch, with nothing else in flight."""
REFILL = 1


def test_unaligned_row_after_a_branch():
    """Three unaligned wide instructions after a branch and a narrow one stall once, two do not."""
    stalls = []
    for count in (2, 3, 4):
        core = Core("c046" + WIDE * count)  # mov r8, r8
        core.state = AFTER_BRANCH
        stalls.append(core.run() - REFILL - count - 1)
    assert stalls == [0, 1, 1]


def test_unaligned_row_after_a_load():
    """Three unaligned wide instructions right after a multi-cycle one stall once; a narrow one cures it."""
    assert total("0868" + WIDE * 2) == 4
    assert total("0868" + WIDE * 3) == 6
    assert total("d1f80000" + "c046" + WIDE * 3) == 6  # ldr.w; mov r8, r8


def test_unaligned_floats():
    """A long sequence of unaligned FP instructions stalls once every three."""
    floats = "30ee810a62ee221a" * 6  # vadd s0, s1, s2; vmul s3, s4, s5
    assert total(floats) == 12
    assert total("00bf" + floats) == 1 + 12 + 4


def cycles_of_loop(code: str, target: int, passes: int) -> int:
    """Cycles of `passes` of a loop that ends the code, entered from the front, left at the last branch."""
    core = Core(code)
    spent = core.run()
    for _ in range(passes - 1):
        spent += core.run(start=ORIGIN + target)
    return spent


def test_taken_branch():
    """A taken branch costs two cycles, three to an unaligned wide instruction (measured: 16 and 19)."""
    wide = "02464ff0010002fb00f0a1f101010029f9d1"  # mov; mov; 1: mul r0, r2; sub r1, #1; cmp r1, #0; bne 1b
    narrow = "02464ff001001044a1f101010029fad1"  # the same with add r0, r2
    assert cycles_of_loop(narrow, 6, 3) == 16
    core = Core(wide)
    core.state = AFTER_BRANCH
    spent = core.run() - REFILL + core.run(start=ORIGIN + 6) + core.run(start=ORIGIN + 6)
    assert spent == 19


def test_loop_of_aligned_wide_instructions():
    """Ten wide NOPs, a wide SUBS and a wide BNE take 13 cycles a pass."""
    loop = "aff30080" * 10 + "b9f10109" + "7ff4e8af"
    assert cycles_of_loop(loop, 0, 11) - cycles_of_loop(loop, 0, 1) == 130


def test_state_is_the_history():
    """Code costs the same in one piece and in pieces, whatever the cut."""
    code = "0868" + "4a68" + WIDE + "04310868" + "30ee201a31ee203a" + "0860" + "4a68" + "80ee201a72ee221a"
    whole = Core(code).run()
    for cut in (ORIGIN + 2, ORIGIN + 4, ORIGIN + 8, ORIGIN + 10, ORIGIN + 16, ORIGIN + 20, ORIGIN + 22):
        core = Core(code)
        assert core.run(end=cut) + core.run(start=cut, taken=False) == whole


@pytest.mark.parametrize("code", ["08680268", "0868" + WIDE * 3, "00bf" + "30ee810a62ee221a" * 6, "0dc90dc9"])
def test_bounds_enclose_the_model(code):
    """The optimistic figure is at most the model's, the pessimistic at least."""
    low, model, high = (total(code, k) for k in (OPTIMISTIC, MODEL, PESSIMISTIC))
    assert low <= model <= high


def test_rows_of_data_are_harmless():
    """Bytes that are no instruction get a row, too, of one halfword and one cycle."""
    rows = decode(b"\xff\xff\xff\xff\x00\xbf", ORIGIN)
    assert np.all(rows[:, 0] != 0)

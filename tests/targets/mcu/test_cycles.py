"""The cost of instructions, from their bytes."""

import pytest

from targets.mcu.cycles import cumulated

ORIGIN = 0x08000000


def total(code: str) -> int:
    """Cycles of hand-assembled Thumb code given as hexadecimal bytes."""
    data = bytes.fromhex(code)
    return int(cumulated(data, ORIGIN, [(ORIGIN, ORIGIN + len(data))])[-1])


@pytest.mark.parametrize(
    ("code", "cycles"),
    [
        ("0130", 1),  # adds r0, #1
        ("00fb01f0", 1),  # mul r0, r0, r1
        ("00fb0120", 2),  # mla r0, r0, r1, r2
        ("0868", 2),  # ldr r0, [r1]
        ("0860", 1),  # str r0, [r1]
        ("0fb4", 5),  # push {r0-r3}
        ("b1e80d00", 4),  # ldm.w r1!, {r0, r2, r3}
        ("30ee201a", 1),  # vadd.f32 s2, s0, s1 (s0 + s1)
        ("80ee201a", 14),  # vdiv.f32 s2, s0, s1
        ("b1eec00a", 14),  # vsqrt.f32 s0, s0
        ("a0ee201a", 3),  # vfma.f32 s2, s0, s1
        ("91ed000a", 2),  # vldr s0, [r1]
        ("b1ec040a", 5),  # vldmia r1!, {s0-s3}
    ],
)
def test_single_instruction(code, cycles):
    """An instruction by itself costs what the technical reference manual says."""
    assert total(code) == cycles


def test_neighbouring_loads_overlap():
    """A second load directly after the first costs one cycle (section 3.3.3)."""
    assert total("0868" + "4a68") == 3  # ldr r0, [r1]; ldr r2, [r1, #4]


def test_dependent_load_does_not_overlap():
    """A load from an address that the load before delivers waits for it."""
    assert total("0868" + "0268") == 4  # ldr r0, [r1]; ldr r2, [r0]


def test_float_result_used_at_once_stalls():
    """An FP operation that uses the result of the one before waits a cycle (section 7.2.3)."""
    independent = total("30ee201a" + "33ee243a")  # vadd s2, s0, s1; vadd s6, s6, s9
    dependent = total("30ee201a" + "31ee203a")  # vadd s2, s0, s1; vadd s6, s2, s1
    assert dependent == independent + 1


def test_data_between_code_costs_nothing():
    """Literal pools are outside the spans of instructions."""
    data = bytes.fromhex("0130" + "ffffffff" + "0130")
    spans = [(ORIGIN, ORIGIN + 2), (ORIGIN + 6, ORIGIN + 8)]
    assert cumulated(data, ORIGIN, spans).tolist() == [0, 1, 1, 1, 2]

"""Calling a function: what it finds, what it costs, what comes back, and how it fails."""

import struct

import pytest

from targets.errors import FirmwareError, FirmwareFault
from targets.mcu import core, native, state
from targets.mcu.call import RETURN, Caller, function, place, word
from targets.mcu.image import parse
from targets.mcu.memory_map import CCM, FLASH, SRAM
from tests.targets.mcu.made import ALLOC, NOTYPE, OBJECT, WRITE, Part, Symbol, elf

MHZ = 1_000_000

# Each a function in Thumb code, at a multiple of 32 bytes from FLASH on.
CODE = {
    "nothing": "7047",  # bx lr
    "sum6": "4018 8018 c018 019b c018 009b c018 7047",  # r0 += r1, r2, r3, [sp+4], [sp]; bx lr
    "push": "f0b5 f0bd",  # push {r4-r7, lr}; pop {r4-r7, pc}
    "count": "0368 0133 0360 1846 7047",  # r3 = [r0]; r3++; [r0] = r3; r0 = r3; bx lr
    "root": "07ee900a b8eec00a b1eec00a 17ee900a 7047",  # vmov s15,r0; vcvt; vsqrt; vmov r0,s15
    "choose": "0128 14bf 0220 0320 7047",  # cmp r0,#1; ite ne; movne r0,#2; moveq r0,#3; bx lr
    "forever": "fee7",  # b .
    "sleep": "30bf 7047",  # wfi; bx lr
    "undefined": "00de",  # udf #0
    "wild": "0068 7047",  # ldr r0, [r0]; bx lr
    "registers": "6846 7146 7047",  # r0 = sp; r1 = lr; bx lr
    "jump": "8047",  # blx r0
    "loop": "0138 fdd1 7047",  # subs r0, #1; bne -2; bx lr
    "store": "0160 7047",  # [r0] = r1; bx lr
}
AT = {name: FLASH + 32 * k for k, name in enumerate(CODE)}


def made(**rest) -> bytes:
    code = b"".join(bytes.fromhex(text).ljust(32, b"\0") for text in CODE.values())
    symbols = [Symbol(name, at + 1) for name, at in AT.items()]
    symbols += [Symbol("fast", SRAM + 0x101), Symbol("word", SRAM, OBJECT), Symbol("table", CCM, OBJECT)]
    symbols += [Symbol("started", SRAM + 0x200, OBJECT), Symbol("$t", FLASH, NOTYPE)]
    symbols += [Symbol("$t", SRAM + 0x100, NOTYPE), Symbol("$d", SRAM + 0x102, NOTYPE)]
    return elf(
        Part(".text", FLASH, code),
        Part(".data", SRAM, struct.pack("<I", 41), flags=ALLOC | WRITE),
        Part(".fast", SRAM + 0x100, bytes.fromhex("7047 7047")),
        Part(".started", SRAM + 0x200, struct.pack("<I", 7), load=FLASH + 0x1000, flags=ALLOC | WRITE),
        Part(".ccm", CCM, b"core", flags=ALLOC | WRITE),
        symbols=tuple(symbols),
        **rest,
    )


IMAGE = parse(made(), "made.elf", vectors=None)


@pytest.fixture(scope="module")
def shared():
    return Caller(IMAGE, 24 * MHZ)


@pytest.fixture
def caller(shared):
    """An MCU as if fresh: setting one up takes longer than all calls of a test."""
    shared.reload()
    return shared


def test_arguments_and_result(caller):
    """Four arguments are in registers, further ones on an aligned stack; the result is in R0."""
    assert caller.call("sum6", [1, 20, 300, 4000, 50000, 600000]).r0 == 654321
    assert caller.call("sum6", [2**32 - 1, 2, 0, 0, 0, 0]).r0 == 1
    assert caller.call("registers", []).r0 == 0x2001C000
    assert caller.call("registers", [0] * 5).r0 == 0x2001BFF8


def test_what_the_function_finds(caller):
    """Registers without an argument are 0, LR leads back, flags are clear, the FPU is on."""
    found = caller.call("registers", [])
    assert found.r1 == RETURN | 1
    caller._enter(AT["nothing"], [7])
    S = caller.mcu.state
    assert [native.get_register(S, core.REG_R0 + k) for k in range(13)] == [7] + [0] * 12
    assert native.get_register(S, core.REG_XPSR) == 1 << 24
    assert S[state.CPACR] & 0xF << 20 == 0xF << 20


def test_data_at_link_addresses(caller):
    """Data lies where it was linked to: in SRAM, in CCM, and what start-up code would have copied."""
    assert caller.dump(SRAM, 4) == struct.pack("<I", 41)
    assert caller.dump(CCM, 4) == b"core"
    assert caller.dump(SRAM + 0x200, 4) == struct.pack("<I", 7)


def test_branch_back_is_paid_for(caller):
    """From the first instruction to the return: a lone BX LR costs itself and the refill, no more."""
    found = caller.call("nothing", [])
    assert (found.cycles, found.instructions) == (1 + 2, 1)


@pytest.mark.parametrize(
    ("name", "arguments", "instructions"),
    [("nothing", [], 1), ("push", [], 2), ("sum6", [0] * 6, 8), ("count", [SRAM], 5), ("root", [4], 5)],
)
def test_instructions_are_counted_exactly(caller, name, arguments, instructions):
    """Every instruction counts once, whether two bytes long or four, however the function returns."""
    assert caller.call(name, arguments).instructions == instructions


def test_instructions_whose_condition_fails_count(caller):
    """An IT block's instructions pass through the pipeline whether executed or not."""
    taken = [caller.call("choose", [k]) for k in (0, 1)]
    assert [found.r0 for found in taken] == [2, 3]
    assert [found.instructions for found in taken] == [5, 5]


@pytest.mark.parametrize("name", ["push", "sum6", "count", "root"])
def test_count_agrees_with_a_hook_on_each_instruction(name):
    """Without IT blocks the count is that of unicorn's own instruction hook, which changes no cycle."""
    import unicorn

    caller = Caller(IMAGE, MHZ)
    alone = caller.call(name, [SRAM])
    seen = []
    caller.mcu.engine.hook_add(unicorn.UC_HOOK_CODE, lambda engine, address, *_: seen.append(address))
    caller.mcu.engine.ctl_flush_tb()
    caller.reload()
    assert caller.call(name, [SRAM]) == alone
    assert alone.instructions == len([address for address in seen if address != RETURN])


def test_calls_are_alike(caller):
    """The same call costs the same each time, memory that it changed or not."""
    first = caller.call("count", [SRAM])
    caller.reload()
    assert caller.call("count", [SRAM]) == first
    assert first.r0 == 42


def test_memory_stays_without_a_reload(caller):
    """What a call wrote the next one finds, until memory is loaded anew."""
    assert [caller.call("count", [SRAM]).r0 for _ in range(3)] == [42, 43, 44]
    caller.reload()
    assert caller.call("count", [SRAM]).r0 == 42


def test_reload_brings_code_back(caller):
    """Code in SRAM that was overwritten is the loaded one again after a reload, and is executed as such."""
    assert caller.call("fast", []).instructions == 1
    caller.call("store", [SRAM + 0x100, 0x47703001])  # adds r0, #1; bx lr
    assert caller.call("fast", [1]).r0 == 2
    caller.reload()
    assert caller.call("fast", [1]).r0 == 1


def test_code_in_sram(caller):
    """A function linked to SRAM is executed there."""
    assert caller.call("fast", [5]).r0 == 5


def test_floating_point(caller):
    """The FPU is on."""
    assert caller.call("root", [0]).r0 == 0


def test_clock_changes_no_cycles():
    """Cycles do not depend on the clock; at zero wait states nothing waits."""
    costs = {hz: Caller(IMAGE, hz).call("sum6", [0] * 6).cycles for hz in (1 * MHZ, 24 * MHZ, 168 * MHZ)}
    assert len(set(costs.values())) == 1


def test_wait_states_reach_the_flash_interface():
    """Wait states stand in FLASH_ACR, with prefetch and caches on as every firmware has them."""
    assert Caller(IMAGE, 168 * MHZ, wait_states=5).mcu.state[state.FLASH_ACR] == 0x705
    assert Caller(IMAGE, 24 * MHZ).mcu.state[state.FLASH_ACR] & 7 == 0


def test_stack_elsewhere():
    """The stack's top may be asked for."""
    assert Caller(IMAGE, MHZ, stack=CCM + 0x1000).call("registers", []).r0 == CCM + 0x1000


@pytest.mark.parametrize(
    ("name", "arguments", "complaint"),
    [
        ("forever", [], "forever has not returned after 100000 cycles at pc 0x080000c0 in forever"),
        ("sleep", [], "sleep sleeps after 100000 cycles at pc 0x"),
        ("undefined", [], "at pc 0x08000100 in undefined"),
        ("wild", [0x60000000], "read outside memory, at 0x60000000 at pc 0x"),
        ("jump", [0x60000001], "fetch"),
        ("jump", [1], "has not returned"),  # flash begins at 0, too
    ],
    ids=["endless", "asleep", "undefined", "unmapped-read", "unmapped-jump", "jump-to-0"],
)
def test_functions_that_do_not_return(caller, name, arguments, complaint):
    """A function that fails or never returns ends in a fault, in bounded time."""
    with pytest.raises(FirmwareFault, match=complaint):
        caller.call(name, arguments, limit_cycles=100_000)


def test_interruption_by_looks_at_the_user_changes_nothing(caller, monkeypatch):
    """However often a call is stopped on its way, it takes the same cycles and instructions."""
    from targets.mcu import call

    whole = caller.call("loop", [1000])
    monkeypatch.setattr(call, "CHUNK_CYCLES", 7)
    caller.reload()
    assert caller.call("loop", [1000]) == whole
    assert whole.instructions == 2 * 1000 + 1


def test_call_after_one_that_slept(caller):
    """A call begins awake, whatever the one before came to."""
    with pytest.raises(FirmwareFault, match="sleeps"):
        caller.call("sleep", [], limit_cycles=1000)
    assert caller.call("nothing", []).instructions == 1


def test_limit_is_of_one_call(caller):
    """Earlier calls do not use up a later one's cycles."""
    for _ in range(5):
        assert caller.call("push", [], limit_cycles=30).instructions == 2


def test_other_than_thumb_functions_are_refused():
    """What is no function, and what is in ARM state, is refused by name."""
    with pytest.raises(FirmwareError, match=r"made.elf: word at 0x20000000 is data, not code"):
        function(IMAGE, "word")
    arm = parse(
        elf(Part(".text", FLASH, bytes(8)), symbols=(Symbol("$a", FLASH, 0), Symbol("f", FLASH))), "a", None
    )
    with pytest.raises(FirmwareError, match="f is in ARM state"):
        function(arm, "f")
    with pytest.raises(FirmwareError, match="no symbol none"):
        function(IMAGE, "none")


def test_labels_of_assembler_are_functions():
    """A global label without a type, as plain assembler leaves it, can be called."""
    plain = parse(
        elf(Part(".text", FLASH, bytes.fromhex("7047")), symbols=(Symbol("f", FLASH, NOTYPE),)), "a", None
    )
    assert Caller(plain, MHZ).call("f", [9]).r0 == 9


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("12", 12),
        ("-1", -1),
        ("0x20", 32),
        ("0b11", 3),
        ("007", 7),
        ("4294967295", 0xFFFFFFFF),
        ("&word", SRAM),
        ("&word+4", SRAM + 4),
        ("&word-0x10", SRAM - 16),
        ("&push", AT["push"] + 1),
    ],
)
def test_arguments_as_text(text, value):
    """Arguments are integers in any notation, or addresses; a function's comes with its Thumb bit."""
    assert word(IMAGE, text) == value


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("x", "neither an integer nor &symbol"),
        ("1.5", "neither an integer"),
        ("", "neither an integer"),
        ("--foo", "neither an integer"),
        ("4294967296", "does not fit 32 bits"),
        ("-2147483649", "does not fit 32 bits"),
        ("&none", "no symbol none"),
        ("&word+x", r"no symbol word\+x"),
    ],
)
def test_arguments_that_are_none(text, complaint):
    """What is neither is refused by name."""
    with pytest.raises(FirmwareError, match=complaint):
        word(IMAGE, text)


def test_places():
    """A place is a symbol's address, with or without an offset; functions without their Thumb bit."""
    assert (place(IMAGE, "table+8"), place(IMAGE, "push")) == (CCM + 8, AT["push"])


@pytest.mark.parametrize(("address", "count"), [(SRAM + 0x1FFFE, 4), (0x40000000, 4), (SRAM, 0)])
def test_dump_outside_memory(caller, address, count):
    """Bytes that are not all in one memory are refused."""
    with pytest.raises(FirmwareError, match="do not lie in memory"):
        caller.dump(address, count)

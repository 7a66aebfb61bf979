"""The core under the sanitizers: thousands of damaged calibrations and garbled frames, every line of it."""

from collections import Counter

import numpy as np
import pytest

from targets.calibration import Detector
from targets.detector import Checks
from targets.ecus import ROLES
from tests.targets.firmware import test_decision
from tests.targets.firmware.images import image_of, resealed, sealed
from tests.targets.firmware.sanitized import CORE, COUNTED, FRAME, Found, build, coverage
from tests.targets.firmware.test_core import HEADS

INPUTS = np.array([(0x100, 4), (0x101, 5), (0x102, 5)])
"""Identifier and length of the frames that the core takes in."""

BASES = (
    image_of(Detector(warmup=0, window=3, multiple=1), 2, 2, 1),
    image_of(Checks(warmup=0, hold_window=4, loss_window=3), 2, 2, 1),
    image_of(Detector(window=1, multiple=1, warmup=0, feedback="measured"), 3, 1),
    image_of(Checks(hold_window=2, loss_window=1, still_mm=0.0, warmup=3), 1, 1),
    image_of(Detector(window=128), 32, 16, 15),
    image_of(Checks(hold_window=128, loss_window=512), 32, 16, 15),
)
"""The smallest, the largest, and some between."""

TELLING = np.array([0, 1, 2, 7, 8, 33, 129, 1 << 31, (1 << 32) - 1], "<u4")
TELLING = np.concatenate(
    [
        TELLING,
        np.array([np.nan, np.inf, -np.inf, 3e38, -3e38, 1e9, -1e9, 1e-45, -0.0, 1e-6], "<f4").view("<u4"),
    ]
)
"""Words at which code goes wrong: ends of ranges, and floats that are none."""


def mutated(rng, image):
    """The image with up to three words replaced, most of them in its head, and mostly a good checksum."""
    words = np.frombuffer(image, "<u4").copy()
    for _ in range(rng.integers(0, 4)):
        at = rng.integers(0, 54 if rng.random() < 0.75 else len(words))
        words[at] = rng.choice(TELLING) if rng.random() < 0.75 else rng.integers(0, 1 << 32)
    return words.tobytes() if rng.random() < 0.1 else resealed(words.tobytes())


def garbled(rng, n):
    """Frames, most of them inputs with counts that go together, with any payload; the rest anything."""
    frames = np.zeros(n, FRAME)
    kind = np.arange(n) % 3
    frames["id"], frames["length"] = INPUTS[kind].T
    frames["data"] = rng.integers(0, 256, (n, 8)) * (rng.random((n, 1)) < 0.9)
    alive = np.cumsum(rng.random(n) < 0.35) * rng.choice([1, 1, 1, 5]) % 16
    for message, byte, shift in ((0, 3, 0), (1, 4, 0), (2, 4, 4)):
        mine = kind == message
        others = frames["data"][mine, byte] & (0xF0 if shift == 0 else 0x0F)
        frames["data"][mine, byte] = others | alive[mine] << shift
    odd = rng.random(n) < 0.05
    frames["id"][odd] = rng.integers(0, 0x800, odd.sum())
    frames["length"][rng.random(n) < 0.05] = rng.integers(0, 9)
    return frames


def bombard(core, seed, images):
    """Mutated images to switch on with, garbled frames to take in: how often each fault, and all replies."""
    rng = np.random.default_rng(seed)
    faults, replies = Counter(), []
    for k in range(images):
        image = mutated(rng, BASES[k % len(BASES)])
        fault = core.init(image, ROLES[k // 6 % 2], room=int(rng.choice([len(image), 16384])))
        faults[fault] += 1
        if fault == 0:
            replies.append(core.frames(garbled(rng, 40), int(rng.integers(0, 1 << 32))))
            core.overrun()
    return faults, np.concatenate(replies)


@pytest.mark.parametrize("seed", range(3))
def test_nothing_shakes_the_core(core, seed):
    """Whatever calibration it is given and accepts, whatever frames: what it computes is a number."""
    faults, replies = bombard(core, seed, 4000)
    assert min(faults[fault] for fault in range(5)) > 20, faults
    assert replies["due"].sum() > 2000
    assert np.isfinite(replies["predicted_mm"]).all()
    assert np.isfinite(replies["residual"]).all()


@pytest.mark.parametrize(
    ("base", "words", "says"),
    [
        (0, {"window": 129}, "residual.c.*out of bounds"),
        (1, {"hold_window": 129}, "checks.c.*out of bounds"),
        (0, {"floor_mm": 0.0}, "residual.c.*division by zero"),
        (1, {"loss_floor_mm": float("nan")}, "checks.c.*outside the range"),
    ],
)
def test_sanitizers_are_awake(program, base, words, says):
    """Settings that the core's check refuses do end the process once they are past it."""
    core = program.start()
    with pytest.raises(Found, match=says):
        core.decide(sealed(BASES[base], **words), np.zeros(200), np.zeros(200))
    with pytest.raises(Found, match=says):
        core.close()


@pytest.mark.usefixtures("program")
def test_every_line_runs(tmp_path):
    """Damaged calibrations, garbled frames and the decision maker's tests take every branch of the core."""
    program = build(tmp_path, *COUNTED)
    core = program.start(tmp_path)
    bombard(core, 9, 600)
    core.init(BASES[0], room=len(BASES[0]) - 4)
    for words, _ in HEADS:
        core.init(sealed(BASES[0], **words))
    for name, test in vars(test_decision).items():
        if name.startswith("test_"):
            test(core.decide)
    core.close()
    found = coverage(program, tmp_path)
    assert {path.name for path in CORE.glob("*.c")} < found.keys()
    print()
    for name, file in sorted(found.items()):
        print(f"{name:15} {file.lines_run:3} of {len(file.lines):3} lines", end=", ")
        print(f"{file.branches_taken:3} of {len(file.branches):3} branches")
    assert not [f"{name}:{line}" for name, file in found.items() for line in file.missed()]

"""The monitor's screen and words: what stands on a terminal of a given size, and nothing beyond it."""

import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from bench.bus.live import LiveBus
from bench.cli import monitor_text as words
from bench.cli.draw import ASCII, BRAILLE
from bench.cli.monitor_screen import Frame, screen, sparkline
from bench.codec import Codec
from bench.monitor.detection import Told
from bench.monitor.model import Monitor
from bench.monitor.trace import BINS
from targets.ecu import Frame as CanFrame

MS = 1_000_000
KEYS = {"1": "rear_stroke:open", "2": "rear_stroke:hold"}
CODEC = Codec()


def sent(name, **signals):
    message = CODEC.message(name)
    values = dict.fromkeys(message.signals, 0.0) | signals
    return CanFrame(message.id, CODEC.encode(name, values)[0].tobytes())


def ridden(alarm=True, cycles=200):
    """A look at a full bus whose IFD has found a fault that acted 43 ms before."""
    monitor = Monitor(CODEC, threshold_pct=10.0)
    for k in range(cycles):
        t_ns, alive = k * 10 * MS, k % 16
        for name in ("STROKES", "MOTION", "ACCELERATIONS"):
            monitor.heard(t_ns, sent(name, alive=alive))
        up = alarm and k >= 100
        status = sent("IFD_STATUS", predicted_mm=k / 4, residual_pct=12.5, alarm=up, kind=up, alive=alive)
        monitor.heard(t_ns + MS, status)
        monitor.heard(t_ns + MS, sent("IFD_TIMING", step_cycles=7700, alive=alive))
    row = {"number": 0, "spec": "rear_stroke:open@1", "state": "active", "t_active_s": 0.958}
    for t_s in (0.9, 1.4):
        monitor.detection.told(round(t_s * 1e9), Told.of({"t_s": t_s, "faults": [row]}))
    return monitor.look(cycles * 10 * MS)


LOOK = ridden()


def drawn(look, width, height, style=BRAILLE, **frame):
    """The screen's lines as a terminal shows them, without colours; taken without any cropping by rich."""
    console = Console(file=io.StringIO(), width=width, height=height, force_terminal=True, color_system=None)
    console.print(screen(look, Frame("virtual:a 500 kbit/s", KEYS, **frame), width, height, style))
    return console.file.getvalue().splitlines()


@pytest.mark.parametrize(("width", "height"), [(80, 24), (120, 40)])
def test_all_of_it(width, height):
    """On a usual terminal everything is there at once: signals, ECU, messages, faults, keys."""
    lines = drawn(LOOK, width, height)
    text = "\n".join(lines)
    for name in ("fork_stroke_mm", "acc_body_ms2", "predicted_mm", "residual_pct", "IFD_TIMING"):
        assert name in text
    assert "ifd  ALARM (open) since 1.0 s, TD 0.043 s, 1 so far" in text
    assert "residual 12.50 % of 10.00 %" in text
    assert "step 0.350 ms (worst 0.350 ms)  CPU 3.5 %  missed 0  overruns 0" in text
    assert "faults: 0 rear_stroke:open@1 active" in text
    assert "1 rear_stroke:open" in text
    assert lines[0].startswith("virtual:a 500 kbit/s  2.0 s  1000 frames  500/s  bus ")


def test_sparkline_on_the_screen():
    """A rising signal is drawn rising, in blocks or, where the output has only ASCII, in its characters."""
    row = next(line for line in drawn(LOOK, 80, 24) if line.startswith("predicted_mm"))
    curve = row.split()[-1]
    assert (curve[0], curve[-1]) == ("▁", "█")
    assert list(curve) == sorted(curve)
    assert all(ord(c) < 128 for line in drawn(LOOK, 80, 24, ASCII) for c in line)


@given(width=st.integers(1, 140), height=st.integers(1, 50), note=st.sampled_from(["", "x" * 300]))
def test_fits(width, height, note):
    """Whatever the terminal's size, no line is longer than it is wide, nor are there more than fit."""
    lines = drawn(LOOK, width, height, note=note, recording="a" * 50)
    assert len(lines) <= height
    assert max(map(len, lines)) <= width


@given(height=st.integers(16, 40))
def test_what_is_not_shown_is_counted(height):
    """Rows that find no room are counted, never dropped in silence."""
    lines = drawn(LOOK, 80, height)
    rows = sum(
        "_mm" in line or "_ms2" in line or "_pct" in line or "_kmh" in line or "_dps" in line
        for line in lines
        if not line.startswith(("faults", "q quit"))
    )
    more = [int(line.split()[1]) for line in lines if line.startswith("... ") and "signals" in line]
    assert rows + sum(more) == len(LOOK.signals)


def test_nothing_heard():
    """A silent bus is said to be silent."""
    assert any("nothing heard yet" in line for line in drawn(Monitor(CODEC).look(0), 80, 24))


def test_paused():
    """A screen that is held says so, and how it goes on."""
    lines = drawn(LOOK, 80, 24, paused=True)
    assert lines[0].startswith("PAUSED")
    assert "space go on" in lines[-1]


def test_complaints_and_notes():
    """What is wrong, and what came of a key, stand above the keys."""
    monitor = Monitor(CODEC)
    monitor.heard(0, CanFrame(0x100, bytes(8)))
    lines = drawn(monitor.look(0), 80, 24, note="fired rear_stroke:open")
    assert lines[-3:-1] == [
        "! STROKES has 8 bytes, motorcycle.dbc says 4: another DBC (1 frames)",
        "fired rear_stroke:open",
    ]


def test_hostile_names(tmp_path):
    """Markup is shown as it stands, escape sequences are not sent, whatever DBC, title and replies hold."""
    path = tmp_path / "other.dbc"
    path.write_text(
        'VERSION ""\nBU_: A\nBO_ 17 TEMP: 1 A\n SG_ oil : 0|8@1+ (1,0) [0|255] "\x1b[2J[red]" A\n',
        encoding="cp1252",
    )
    monitor = Monitor(Codec(path))
    monitor.heard(0, CanFrame(17, b"\x07"))
    text = "\n".join(drawn(monitor.look(0), 120, 24, note="\x1b]0;x\x07[blink]", recording="a\nb[/]"))
    assert "\x1b" not in text
    assert "\x07" not in text
    assert "\\x1b[2" in text
    assert "[blink]" in text
    assert "a\\nb[/]" in text


def test_stale_message():
    """A message that has stopped keeps its values; its rate says that it has."""
    monitor = Monitor(CODEC)
    monitor.heard(0, sent("STROKES", fork_stroke_mm=75))
    lines = drawn(monitor.look(5_000 * MS), 80, 24)
    assert any(line.startswith("fork_stroke_mm") and " 75.0" in line for line in lines)
    assert any(line.startswith("STROKES") and " 0.0 " in line for line in lines)


@pytest.mark.parametrize("style", [BRAILLE, ASCII])
def test_sparkline(style):
    """From lowest to highest mark; nothing where there is nothing; the middle for what never changes."""
    ramp = sparkline(np.arange(40.0), 8, style)
    assert (ramp[0], ramp[-1]) == (("_", "#") if style == ASCII else ("▁", "█"))
    assert list(ramp) == sorted(ramp, key=list(dict.fromkeys(ramp)).index)
    half = np.full(40, np.nan)
    half[20:] = 3.0
    assert sparkline(half, 4, style)[:2] == "  "
    assert len(set(sparkline(half, 4, style)[2:])) == 1
    assert sparkline(np.full(40, np.nan), 4, style) == "    "


@given(
    st.lists(st.one_of(st.none(), st.floats(-1e300, 1e300)), min_size=BINS, max_size=BINS),
    st.integers(1, 500),
)
def test_sparkline_has_its_width(values, width):
    """Any values give exactly as many characters as asked for."""
    means = np.array([np.nan if value is None else value for value in values])
    assert len(sparkline(means, width, BRAILLE)) == width


def test_line():
    """One second in one line: frames, rate, load, errors, the ECU."""
    assert words.line(LOOK) == (
        f"     2.0 s  1000 frames  500/s  bus {100 * LOOK.load:.1f} %  lost 0  repeats 0  ifd  "
        "residual 12.50 % of 10.00 %  ALARM (open) since 1.0 s, TD 0.043 s, 1 so far  "
        "step 0.350 ms  load 3.5 %  missed 0  overruns 0"
    )


def test_summary_and_document():
    """At the end: each message with its frames, mean rate and counter errors, in words and for JSON."""
    lines = words.summary(LOOK)
    assert lines[0] == "1000 frames in 2.0 s, 0 of them unknown to the DBC"
    assert lines[2].split() == ["STROKES", "0x100", "200", "100.0", "0", "0", "0"]
    document = words.document(LOOK)
    assert document["messages"]["IFD_STATUS"]["frames"] == 200
    assert document["ecus"]["ifd"]["td_s"] == pytest.approx(0.043)
    assert document["ecus"]["ifd"]["step_ms"] == pytest.approx(0.35)


def test_kernel_tells_nothing_of_a_virtual_bus():
    """Where there is no socket nobody counts what is dropped."""
    with LiveBus("virtual:drops") as bus:
        assert bus.dropped() is None

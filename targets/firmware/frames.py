"""Writes `core/frames.h` from the DBC, so that the CAN layout stands in one place.

The firmware reads what MDLOG sends as physical floats and writes what its own node sends. Rounding is half to
even after saturation, the rule of the bench's own codec.
"""

from pathlib import Path
from typing import Any

from dbc import CHANNELS, MOTORCYCLE
from targets.errors import FirmwareError

HEADER = Path(__file__).parent / "core" / "frames.h"

_PREAMBLE = """\
/* Made from dbc/motorcycle.dbc by `python -m targets.firmware.frames`; change that, not this. */
#ifndef FRAMES_H
#define FRAMES_H

#include <stdint.h>

/* Half to even, for 0 <= x < 2^22: the addition rounds, as every IEEE 754 addition does. */
static inline uint32_t frames_round(float x) { return (uint32_t)((x + 8388608.0f) - 8388608.0f); }

static inline uint32_t frames_saturate(float x, float top) {
    if (!(x > 0.0f)) return 0u; /* NaN goes to zero, too */
    return x >= top ? (uint32_t)top : frames_round(x);
}
"""


def generate(path: Path = MOTORCYCLE) -> str:
    """The C header for the DBC file at `path`; FirmwareError for a layout the generator does not know."""
    import cantools

    database = cantools.database.load_file(path)
    inputs = [m for m in database.messages if m.senders == ["MDLOG"]]
    # what the bench notes in its recordings is no ECU's business
    outputs = [m for m in database.messages if m.senders not in (["MDLOG"], ["BENCH"])]
    parts = [_PREAMBLE, _enums(inputs), _read(inputs)]
    for message in outputs:
        parts.append(_writers(message))
    parts.append("#endif\n")
    return "\n".join(parts)


def _enums(inputs: list[Any]) -> str:
    carrier = {s.name: m.name for m in inputs for s in m.signals}
    lines = ["enum channel {"]
    lines += [f"    CHANNEL_{name.upper()}," for name in CHANNELS]
    lines += ["    CHANNELS", "};", "", "enum message {"]
    lines += [f"    MESSAGE_{m.name}," for m in inputs]
    ids = ", ".join(f"{m.frame_id}u" for m in inputs)
    lines += [
        "    MESSAGES",
        "};",
        f"#define FRAMES_MESSAGE_IDS {{{ids}}}",
        "",
        "static inline uint32_t frames_message_of(uint32_t channel) {",
    ]
    lines += ["    static const uint8_t message[CHANNELS] = {"]
    lines += [f"        MESSAGE_{carrier[name]}, /* {name} */" for name in CHANNELS]
    lines += ["    };", "    return message[channel];", "}", ""]
    return "\n".join(lines)


def _read(inputs: list[Any]) -> str:
    lines = [
        "/* Takes a frame of the data logger apart; the message it is, or -1 if it is not one of them. */",
        "static inline int frames_read(uint32_t id, uint32_t length, const uint8_t *d, float *channel,",
        "                              uint32_t *alive) {",
        "    uint32_t raw;",
    ]
    for message in inputs:
        lines.append(f"    if (id == {message.frame_id}u && length == {message.length}u) {{")
        for signal in message.signals:
            _check(signal)
            raw = _extract(signal)
            if signal.name == "alive":
                lines.append(f"        *alive = {raw};")
                continue
            lines.append(f"        raw = {raw};")
            value = "(float)raw"
            if signal.is_signed:
                bits = 32 - signal.length
                value = f"(float)((int32_t)(raw << {bits}) >> {bits})"
            lines.append(
                f"        channel[CHANNEL_{signal.name.upper()}] = {value} * {_float(signal.scale)};"
            )
        lines += [f"        return MESSAGE_{message.name};", "    }"]
    lines += ["    return -1;", "}", ""]
    return "\n".join(lines)


def _writers(message: Any) -> str:
    name = message.name.lower()
    lines = [
        f"#define {message.name}_ID {message.frame_id}u",
        f"#define {message.name}_LENGTH {message.length}u",
        "",
    ]
    for signal in message.signals:
        _check(signal)
        physical = signal.scale != 1
        kind = "float v" if physical else "uint32_t raw"
        lines.append(f"static inline void {name}_set_{signal.name}(uint8_t *d, {kind}) {{")
        if physical:
            top = float(2**signal.length - 1)
            lines.append(f"    uint32_t raw = frames_saturate(v / {_float(signal.scale)}, {_float(top)});")
        lines += [f"    {line}" for line in _insert(signal)]
        lines += ["}", ""]
    return "\n".join(lines)


def _check(signal: Any) -> None:
    if signal.byte_order != "little_endian" or signal.offset != 0 or signal.length > 32:
        raise FirmwareError(
            f"signal {signal.name}: the firmware reads little-endian signals of at most 32 bits, offset 0"
        )


def _pieces(signal: Any) -> list[tuple[int, int, int, int]]:
    """Per byte touched: its index, the lowest bit in it, the bits taken, the signal's bit they start at."""
    pieces = []
    done = 0
    while done < signal.length:
        byte, low = divmod(signal.start + done, 8)
        count = min(8 - low, signal.length - done)
        pieces.append((byte, low, count, done))
        done += count
    return pieces


def _extract(signal: Any) -> str:
    terms = []
    for byte, low, count, at in _pieces(signal):
        term = f"(uint32_t)d[{byte}]"
        if low:
            term = f"({term} >> {low})"
        if count + low < 8:
            term = f"({term} & {2**count - 1}u)"
        terms.append(f"({term} << {at})" if at else term)
    return " | ".join(terms)


def _insert(signal: Any) -> list[str]:
    lines = []
    for byte, low, count, at in _pieces(signal):
        term = f"raw >> {at}" if at else "raw"
        if count == 8:
            lines.append(f"d[{byte}] = (uint8_t)({term});")
        else:
            mask = 2**count - 1
            keep = 0xFF ^ mask << low
            lines.append(
                f"d[{byte}] = (uint8_t)((d[{byte}] & 0x{keep:02X}u) | ((({term}) & {mask}u) << {low}));"
            )
    return lines


def _float(value: float) -> str:
    """A C literal of the nearest single-precision number."""
    import numpy as np

    return f"{float(np.float32(value)).hex()}f"


if __name__ == "__main__":
    HEADER.write_text(generate(), encoding="utf-8")

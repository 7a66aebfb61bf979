"""What the monitor says in words: the line of a second, the summary at the end, the document."""

import math
from typing import Any

from bench.monitor.rows import EcuRow, Look


def of(value: float | None, form: str) -> str:
    """A number, '-' where there is none."""
    return "-" if value is None or math.isnan(value) else format(value, form)


def ms(seconds: float | None) -> str:
    """A time in ms."""
    return "-" if seconds is None else f"{1e3 * seconds:.3f} ms"


def percent(share: float | None) -> str:
    """A share of 1."""
    return "-" if share is None else f"{100 * share:.1f} %"


def line(look: Look) -> str:
    """One second of the bus in one line."""
    parts = [
        f"{look.t_ns / 1e9:8.1f} s",
        f"{look.frames} frames",
        f"{look.per_s:.0f}/s",
        f"bus {percent(look.load)}",
        f"lost {look.lost}",
        f"repeats {look.repeats}",
    ]
    if look.unknown:
        parts.append(f"unknown {look.unknown}")
    if look.dropped:
        parts.append(f"dropped {look.dropped}")
    parts += [_ecu(ecu) for ecu in look.ecus]
    return "  ".join(parts)


def summary(look: Look) -> list[str]:
    """What was heard from beginning to end, as lines."""
    worst = f", read up to {look.worst_age_ns / 1e6:.1f} ms late" if look.worst_age_ns else ""
    dropped = "" if look.dropped is None else f", {look.dropped} dropped by the kernel"
    lines = [
        f"{look.frames} frames in {look.t_ns / 1e9:.1f} s, {look.unknown} of them unknown to the DBC"
        f"{dropped}{worst}"
    ]
    if look.messages:
        lines.append(
            f"{'message':<16}{'id':>9}{'frames':>10}{'per s':>9}{'lost':>7}{'repeats':>9}{'restarts':>10}"
        )
    lines += [
        f"{row.name:<16}{row.id:>#9x}{row.frames:>10}{row.mean_per_s:>9.1f}{of(row.lost, 'd'):>7}"
        f"{of(row.repeats, 'd'):>9}{of(row.restarts, 'd'):>10}"
        for row in look.messages
    ]
    lines += [_ecu(ecu) for ecu in look.ecus]
    lines += [f"! {complaint}" for complaint in look.complaints]
    return lines


def document(look: Look) -> dict[str, Any]:
    """The same for JSON."""
    return {
        "seconds": look.t_ns / 1e9,
        "frames": look.frames,
        "lost": look.lost,
        "repeats": look.repeats,
        "unknown": {"frames": look.unknown, "ids": look.unknown_ids},
        "dropped": look.dropped,
        "worst_age_ms": look.worst_age_ns / 1e6,
        "messages": {
            row.name: {
                "id": row.id,
                "frames": row.frames,
                "per_s": row.mean_per_s,
                "lost": row.lost,
                "repeats": row.repeats,
                "restarts": row.restarts,
                "wrong_length": row.wrong,
            }
            for row in look.messages
        },
        "ecus": {
            ecu.role: {
                "answers": ecu.answers,
                "alarms": ecu.alarms,
                "alarm": ecu.alarm,
                "kind": ecu.kind,
                "td_s": ecu.td_s,
                "step_ms": None if ecu.step_s is None else 1e3 * ecu.step_s,
                "worst_step_ms": None if ecu.worst_step_s is None else 1e3 * ecu.worst_step_s,
                "cpu_load": ecu.load,
                "missed_inputs": ecu.missed_inputs,
                "overruns": ecu.overruns,
            }
            for ecu in look.ecus
        },
        "complaints": list(look.complaints),
    }


def residual(ecu: EcuRow) -> str:
    """The residual, against its threshold where that is known."""
    text = f"residual {of(ecu.residual_pct, '.2f')} %"
    return text if ecu.threshold_pct is None else f"{text} of {ecu.threshold_pct:.2f} %"


def alarm(ecu: EcuRow) -> str:
    """Whether the alarm is up, what it named, how long it took."""
    if not ecu.alarms:
        return "no alarm"
    kind = f" ({ecu.kind})" if ecu.kind else ""
    state = "ALARM" if ecu.alarm else "alarm over"
    since, td = of(ecu.since_s, ".1f"), of(ecu.td_s, ".3f")
    return f"{state}{kind} since {since} s, TD {td} s, {ecu.alarms} so far"


def _ecu(ecu: EcuRow) -> str:
    parts = [ecu.role]
    if ecu.residual_pct is not None and not math.isnan(ecu.residual_pct):
        parts += [residual(ecu), alarm(ecu)]
    parts += [f"step {ms(ecu.step_s)}", f"load {percent(ecu.load)}"]
    parts += [f"missed {ecu.missed_inputs}", f"overruns {ecu.overruns}"]
    return "  ".join(parts)

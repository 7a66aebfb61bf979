"""Rows of a store that was never run, and their freeze frames."""

import hashlib
import json

import numpy as np

from campaigns.road_plan import RoadPlan
from campaigns.store import Row, Store, trial_id

MS = 1_000_000
S = 1_000_000_000
HZ = 22_000_000

CAMPAIGN = {
    "name": "road",
    "title": "Road trial",
    "stands_for": "section V.6, Tables V.14 and V.15",
    "plan": {"laps": 20, "route": "mixed_5km"},
    "ecu": [{"ecu": "ifd", "runs_on": "mcu", "firmware_sha256": "f" * 64, "calibration_sha256": "c" * 64}],
    "laps": None,
    "versions": {"strokebench": "0.1.0", "numpy": "2.4.6"},
}


PLAN = RoadPlan(
    title="Road trial",
    stands_for="a test",
    route="mixed_5km",
    laps=1,
    seed=1,
    fault_window_s=(1, 2),
    faults={"hold": "rear_stroke:hold", "open": "rear_stroke:open"},
)
ROAD = {**CAMPAIGN, "conditions": list(PLAN.faults), "plan": PLAN.model_dump(mode="json")}
"""A campaign's document that can be read again."""


def road_store(path, rows, shown=None):
    """A store of ROAD with these rows, each with the same freeze frame."""
    with Store.open(path, ROAD) as store:
        for one in rows:
            store.put(trial_id(one.trial), one.trial, one.result, shown)
    return path


def row(
    condition, outcome, seed=1, td_s=None, named=None, parameters=None, ecu="ifd", ridden_s=360.0, **more
):
    """One row; td_s: of a detection in time. more: of trial or result, whichever has such a field."""
    fault = "" if condition == "fault-free" else f"rear_stroke:{condition}@60"
    trial = {
        "kind": "road",
        "condition": condition,
        "parameters": parameters or {},
        "lap": {"route": "mixed_5km", "motorcycle": "gsxr1000", "seed": seed, "seconds": None},
        "sensors": "datasheet",
        "sensors_seed": seed,
        "fault": fault,
        "td_max_s": 120.0,
        "ftti_s": None,
        "ecu": {"ecu": ecu, "runs_on": "mcu", "firmware_sha256": "f" * 64, "calibration_sha256": "c" * 64},
    }
    td_ns = None if td_s is None else round(td_s * S)
    active = None if not fault else 60 * S
    result = {
        "outcome": outcome,
        "reason": {"CD": f"alarm {td_s} s after the fault acted", "INVALID": "frames lost"}.get(
            outcome, "why"
        ),
        "named": named,
        "t_cmd_ns": active,
        "t_active_ns": active,
        "t_obs_ns": active and active + 20 * MS,
        "t_alarm_ns": active + td_ns if fault and td_s is not None else 30 * S if outcome == "FA" else None,
        "t_heal_ns": None,
        "td_ns": td_ns,
        "alarms": int(outcome in ("CD", "FA", "ID")),
        "ridden_ns": round(ridden_s * S),
        "steps": {
            "n": 2,
            "cycles": 11000,
            "squares": 60500000,
            "least": 5500,
            "most": 5500,
            "hz": 22_000_000,
        },
        "bus_load": 0.0975,
    }
    for name, value in more.items():
        (trial if name in trial else result)[name] = value
    return Row(hashlib.sha256(json.dumps(trial, sort_keys=True).encode()).hexdigest()[:16], trial, result)


def frame(_id, samples=1000, seed=0):
    """A freeze frame around 60 s: a bumpy road's stroke, its prediction, the residual; held from 60 s on."""
    rng = np.random.default_rng(seed)
    t_s = 55 + 0.01 * np.arange(samples)
    phases = rng.uniform(0, 6, 6)
    stroke = 45 + sum(
        9 / (k + 1) * np.sin(2 * np.pi * (0.35 + 0.6 * k) * t_s + phase) for k, phase in enumerate(phases)
    )
    measured = stroke + rng.normal(0, 0.25, samples)
    predicted = stroke + np.convolve(rng.normal(0, 2.5, samples), np.ones(12) / 12, "same")
    measured[t_s >= 60] = measured[t_s < 60][-1]
    return {
        "t0_ns": 55 * S,
        "period_ns": 10 * MS,
        "measured_mm": measured.tolist(),
        "predicted_mm": predicted.tolist(),
        "residual_pct": (100 * abs(measured - predicted) / measured).tolist(),
    }

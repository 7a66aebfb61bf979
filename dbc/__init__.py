"""Where the CAN layout lives: `motorcycle.dbc`, and nothing else that says where a bit goes."""

from pathlib import Path

MOTORCYCLE = Path(__file__).with_name("motorcycle.dbc")

CHANNELS = (
    "fork_stroke_mm",
    "rear_stroke_mm",
    "pitch_rate_dps",
    "speed_kmh",
    "acc_front_ms2",
    "acc_rear_ms2",
    "acc_body_ms2",
)
"""The quantities of section II.5, each with its unit in its name: lap files' columns and CAN signals bear it.

An ECU's calibration names an input by its position here.
"""

"""Faults of the sensors: how one is written, what each kind does, and inserting it into a lap's codes."""

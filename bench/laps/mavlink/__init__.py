"""MAVLink telemetry and ArduPilot DataFlash as laps."""

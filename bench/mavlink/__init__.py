"""The bench on a ground station: telemetry, alarms and commands as MAVLink packets. Sans-I/O."""

"""The CAN bus: how long a frame is, and a bus in virtual time."""

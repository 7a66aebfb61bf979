"""The emulated bench: everything left of the CAN bus, and the rig that wires it to an ECU."""

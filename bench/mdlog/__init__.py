"""The emulated MDLog data logger: sensor codes in, the schedule of its CAN frames out."""

"""GDB's end of the bench: its remote protocol, and an ECU that runs and halts as a debugger says."""

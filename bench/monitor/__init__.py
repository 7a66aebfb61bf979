"""What a listener sees of a bus: signals, rates, counters, the ECU. Sans-I/O: frames in, rows out."""

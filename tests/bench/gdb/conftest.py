"""A machine that is only registers and bytes, for what the debugger says to it."""

import pytest

from bench.gdb.description import REGISTERS

BASE = 0x20000000


class Machine:
    """Registers that hold their numbers, 64 kB of memory at BASE."""

    def __init__(self):
        self.values = {register.name: number for number, register in enumerate(REGISTERS)}
        self.memory = bytearray(range(256)) * 256
        self.points = []

    def registers(self):
        return self.values

    def write_register(self, name, value):
        self.values[name] = value

    def read_memory(self, address, count):
        at = address - BASE
        return bytes(self.memory[at : at + count]) if at >= 0 else b""

    def write_memory(self, address, data):
        at = address - BASE
        if not 0 <= at <= len(self.memory) - len(data):
            return False
        self.memory[at : at + len(data)] = data
        return True

    def insert(self, kind, address, length):
        if kind == "access":
            return False
        self.points.append((kind, address, length))
        return True

    def remove(self, kind, address, length):
        if (kind, address, length) not in self.points:
            return False
        self.points.remove((kind, address, length))
        return True


@pytest.fixture
def machine():
    return Machine()

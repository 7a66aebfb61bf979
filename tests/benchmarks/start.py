"""What `bench --help` costs in CPU time, beside a command of typer's that does nothing.

python -m tests.benchmarks.start [REPEAT]
"""

import os
import subprocess
import sys

EMPTY = "import typer\napp = typer.Typer()\n@app.command()\ndef f(): 'Nothing.'\napp()"
WAYS = {
    "bench --help": ["-m", "bench.cli.main", "--help"],
    "typer --help": ["-c", EMPTY, "--help"],
    "python": ["-c", "pass"],
}


def cpu_s(arguments: list[str]) -> float:
    """CPU seconds, user and system, of one Python process."""
    process = subprocess.Popen([sys.executable, *arguments], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{arguments} ended with {process.returncode}")
    return usage.ru_utime + usage.ru_stime


def main() -> None:
    """Print the median and the best of each, taken in turn."""
    repeat = int(sys.argv[1]) if len(sys.argv) > 1 else 11
    spent: dict[str, list[float]] = {name: [] for name in WAYS}
    for _ in range(repeat):
        for name, arguments in WAYS.items():
            spent[name].append(cpu_s(arguments))
    peer = sorted(spent["typer --help"])[repeat // 2]
    for name, times in spent.items():
        median = sorted(times)[repeat // 2]
        print(f"{name:14} median {median:.3f} s  best {min(times):.3f} s  {median / peer:5.2f} x")


if __name__ == "__main__":
    main()

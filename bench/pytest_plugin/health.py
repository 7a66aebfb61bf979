"""Bus health at the end of a test: what happened on the bus that must not, whatever the test looked at."""

from bench.pytest_plugin.ride import Bench


def complaints(bench: Bench) -> list[str]:
    """What is wrong with bus, bench and ECU so far, one line each; none: all is well."""
    watch, found = bench.watch, []
    if bench.failure:
        found.append(bench.failure)
    # the answer to the last cycle may be under way; one that is missing for good is the ride's failure
    missing = watch.cycles - 1 - watch.answered
    if missing > 0 and not found:
        found.append(f"{missing} of {watch.cycles} input cycles were not answered")
    if watch.garbled:
        found.append(f"unreadable answer: {watch.garbled}")
    if watch.missed_inputs:
        found.append(f"frames lost: the ECU missed {watch.missed_inputs} input cycles")
    if watch.overruns:
        found.append(f"ECU overrun: {watch.overruns} input cycles waited for the step before")
    if bench.error_frames:
        found.append(f"{bench.error_frames} error frames")
    return found + bench.ecu.fitted.complaints

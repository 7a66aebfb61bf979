"""The compiled decision of Figure V.8 for many T, L and n at once.

Belongs here: `targets.ifd`'s residual and rule, for every cell of a table in one pass. Never: a fault, a lap,
an outcome. Calls no kernel of another file: the disk cache would not notice when that one changed.
"""

import numpy as np
from numpy.typing import NDArray

from targets.jit import njit

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


# error_model: Python's check for a division by 0 would keep the compiler from vectorising
@njit(cache=True, nogil=True, error_model="numpy")
def first_alarms(
    measured: Floats, predicted: Floats, floor: float, thresholds: Floats, windows: Integers,
    multiples: Integers, skip: int, found: Integers,
) -> None:  # fmt: skip
    """Fill `found` (T, L, n): the sample at which each cell first raises its alarm, -1 if it never does.

    measured, predicted (samples,); floor: the least stroke (V.1) divides by; thresholds relative, windows in
    samples and multiples, each increasing. Exceedances of the first `skip` samples do not count; before the
    first sample the deviation counts as zero. Ends as soon as every cell has its alarm.
    """
    longest = windows[-1]
    samples = measured.shape[0]
    deviation = np.zeros(longest + samples)
    sums = np.zeros(longest + 1)  # of the newest k deviations
    above = np.zeros((thresholds.size, windows.size), dtype=np.int64)
    nth = np.zeros((thresholds.size, windows.size), dtype=np.int64)  # the multiple each waits for
    found[:] = -1
    waiting = found.size
    for i in range(samples):
        newest = longest + i
        deviation[newest] = abs(predicted[i] - measured[i]) / max(abs(measured[i]), floor)
        if i < skip:
            continue
        # E_mean,L(i) = 1/L_s sum_k |(y_p - y_m) / y_m| (V.1), newest first: the sums of all L in one pass,
        # and the same bits wherever the first sample lies
        total = 0.0
        for k in range(longest):
            total += deviation[newest - k]
            sums[k + 1] = total
        for j in range(windows.size):
            mean = sums[windows[j]] / windows[j]
            for t in range(thresholds.size):
                if not mean > thresholds[t]:
                    above[t, j] = 0
                    continue
                above[t, j] += 1
                # above T for n windows on end (Figure V.8)
                if nth[t, j] < multiples.size and above[t, j] >= multiples[nth[t, j]] * windows[j]:
                    found[t, j, nth[t, j]] = i
                    nth[t, j] += 1
                    waiting -= 1
        if waiting == 0:
            return

"""The compiled recursion of a NARX network, in normalised units.

Belongs here: the forward pass, in the closed loop and on measured outputs. Never: units, training.
The regressor order is fixed, the firmware uses it (eq. III.1):
x = [u1(t-1) .. u1(t-d), u2(t-1) .., ..., y(t-1) .. y(t-d)].
Only additions, multiplications and divisions in a fixed order: the same bits on every machine.
"""

import numpy as np
from numpy.typing import NDArray

from targets.jit import njit

Floats = NDArray[np.float64]

WIDTH = 8
"""Neurons are padded to a multiple of this with zero weights, for the vector units."""


def packed(W1: Floats, b1: Floats, w2: Floats) -> tuple[Floats, Floats, Floats]:
    """Return W1 transposed (n_x, N), b1 and w2 (N,), with N padded by neurons that add exactly 0."""
    more = -b1.size % WIDTH
    return (
        np.ascontiguousarray(np.pad(W1, ((0, more), (0, 0))).T),
        np.pad(b1, (0, more)),
        np.pad(w2, (0, more)),
    )


# error_model: Python's check for a division by 0 would keep the compiler from vectorising
@njit(cache=True, nogil=True, error_model="numpy")
def tanh_all(a: Floats) -> None:
    """Replace each value by its hyperbolic tangent, within 1e-14; unlike libm's, it vectorises."""
    for i in range(a.shape[0]):
        # E = exp(-2|x|) = exp(-2|x|/64)^64, by its Taylor series; past 20 the tangent rounds to 1
        s = min(abs(a[i]), 20.0) * (-2.0 / 64.0)
        e = 1.0 + s / 14.0
        e = 1.0 + s * e * (1.0 / 13.0)
        e = 1.0 + s * e * (1.0 / 12.0)
        e = 1.0 + s * e * (1.0 / 11.0)
        e = 1.0 + s * e * (1.0 / 10.0)
        e = 1.0 + s * e * (1.0 / 9.0)
        e = 1.0 + s * e * (1.0 / 8.0)
        e = 1.0 + s * e * (1.0 / 7.0)
        e = 1.0 + s * e * (1.0 / 6.0)
        e = 1.0 + s * e * (1.0 / 5.0)
        e = 1.0 + s * e * (1.0 / 4.0)
        e = 1.0 + s * e * (1.0 / 3.0)
        e = 1.0 + s * e * (1.0 / 2.0)
        e = 1.0 + s * e
        e *= e
        e *= e
        e *= e
        e *= e
        e *= e
        e *= e
        a[i] = np.copysign((1.0 - e) / (1.0 + e), a[i])


@njit(cache=True, nogil=True)
def regressors(v: Floats, t: int, feedback: Floats, x: Floats) -> None:
    """Fill `x` (n_x,) for step `t`.

    v (d + samples, n_u): inputs behind d samples of history, so that u(t-k) is v[d + t - k];
    feedback (d,): the outputs before `t`, the most recent first.
    """
    d = feedback.shape[0]
    j = 0
    for channel in range(v.shape[1]):
        for k in range(1, d + 1):
            x[j] = v[d + t - k, channel]
            j += 1
    for k in range(d):
        x[j] = feedback[k]
        j += 1


@njit(cache=True, nogil=True)
def layer(W1T: Floats, b1: Floats, x: Floats, a: Floats) -> None:
    """a = tanh(W1 x + b1), with W1T, b1 from `packed`."""
    for i in range(a.shape[0]):
        a[i] = b1[i]
    whole = x.shape[0] // 4 * 4
    for j in range(0, whole, 4):  # by four: else each addition waits for the one before to reach memory
        for i in range(a.shape[0]):
            a[i] += (W1T[j, i] * x[j] + W1T[j + 1, i] * x[j + 1]) + (
                W1T[j + 2, i] * x[j + 2] + W1T[j + 3, i] * x[j + 3]
            )
    for j in range(whole, x.shape[0]):
        for i in range(a.shape[0]):
            a[i] += W1T[j, i] * x[j]
    tanh_all(a)


@njit(cache=True, nogil=True)
def push(feedback: Floats, value: float) -> None:
    """Move the delay line on by one sample."""
    for k in range(feedback.shape[0] - 1, 0, -1):
        feedback[k] = feedback[k - 1]
    feedback[0] = value


@njit(cache=True, nogil=True)
def forward(
    W1T: Floats, b1: Floats, w2: Floats, b2: float, v: Floats, start: Floats,
    closed: bool, measured: Floats, y: Floats,
) -> None:  # fmt: skip
    """Fill `y` (samples,): what the network predicts for each sample.

    closed: the parallel form, where its own outputs are fed back, and `measured` (samples,) is not read;
    else the series-parallel form, where `measured` is fed back.
    W1T, b1, w2 from `packed`; v (d + samples, n_u) as in `regressors`; start (d,): the fed-back outputs
    before the first step, the most recent first.
    """
    feedback = start.copy()
    x = np.empty(W1T.shape[0])
    a = np.empty(W1T.shape[1])
    for t in range(y.shape[0]):
        regressors(v, t, feedback, x)
        layer(W1T, b1, x, a)
        # y(t) = w2 . tanh(W1 x + b1) + b2
        out = b2
        for i in range(a.shape[0]):
            out += w2[i] * a[i]
        y[t] = out
        push(feedback, out if closed else measured[t])

"""Rows of the Jacobian of a NARX network's output by its weights, in the parallel form.

Belongs here: the compiled recursion of the sensitivities. Never: what the rows are used for.
The weights in one vector: theta = [W1 row by row, b1, w2, b2].
"""

import numpy as np
from numpy.typing import NDArray

from targets.jit import njit
from targets.narx.recursion import layer, push, regressors

Floats = NDArray[np.float64]


def unpacked(theta: Floats, neurons: int) -> tuple[Floats, Floats, Floats, float]:
    """Split theta (P,) into W1 (N, n_x), b1 (N,), w2 (N,) and b2; views, where they can be."""
    n_x = (theta.size - 1) // neurons - 2
    W1 = theta[: neurons * n_x].reshape(neurons, n_x)
    b1, w2 = theta[neurons * n_x : -1].reshape(2, neurons)
    return W1, b1, w2, float(theta[-1])


@njit(cache=True, nogil=True)
def rows(W1T, b1, w2, b2, neurons, v, measured, weight, begin, feedback, sensitivity, out):  # type: ignore[no-untyped-def]
    """Write weighted Jacobian rows and residuals for samples begin .. begin + C of one segment.

    W1T, b1, w2 from `recursion.packed`, of which the first `neurons` are trained; v (d + L, n_u);
    measured, weight (L,). out (C, P + 1): a row holds weight * dy(t)/dtheta, then weight * (y - measured);
    zeros where the weight is 0 and past the segment's end.

    The sensitivity is itself a recursion (forward sensitivity), with df/dtheta the series-parallel form's:
    dy(t)/dtheta = df/dtheta + sum_k df/dy(t-k) dy(t-k)/dtheta.
    feedback (d,) and sensitivity (d, P), a ring by t modulo d, carry the state from block to block: both
    are changed. The sensitivities start at 0, for the outputs before a segment do not depend on theta.
    The network runs in float64, the sensitivities in the type of their array.
    """
    d = feedback.shape[0]
    n_x = W1T.shape[0]
    P = sensitivity.shape[1]
    x = np.empty(n_x)
    a = np.empty(W1T.shape[1])
    # the same numbers in the type of the sensitivities: mixed types would not vectorise
    x_s = np.empty(n_x, sensitivity.dtype)
    delta = np.empty(neurons, sensitivity.dtype)
    gain = np.empty(d, sensitivity.dtype)
    w = np.empty(1, sensitivity.dtype)
    for c in range(out.shape[0]):
        t = begin + c
        if t >= measured.shape[0]:
            out[c, :] = 0.0
            continue
        regressors(v, t, feedback, x)
        layer(W1T, b1, x, a)
        y = b2
        for i in range(neurons):
            y += w2[i] * a[i]
            delta[i] = w2[i] * (1.0 - a[i] * a[i])
        x_s[:] = x
        s = sensitivity[t % d]  # of y(t-d) on entry, of y(t) on leaving
        for k in range(d):
            # df/dy(t-k) = sum_i w2_i (1 - a_i^2) W1_i,y(t-k)
            g = 0.0
            for i in range(neurons):
                g += delta[i] * W1T[n_x - d + k, i]
            gain[k] = g
        oldest = gain[d - 1]
        for p in range(P):
            s[p] *= oldest
        fours = 1 + (d - 1) // 4 * 4
        for k in range(1, fours, 4):  # by four, as in `layer`
            g1, g2, g3, g4 = gain[k - 1], gain[k], gain[k + 1], gain[k + 2]
            s1, s2 = sensitivity[(t - k) % d], sensitivity[(t - k - 1) % d]
            s3, s4 = sensitivity[(t - k - 2) % d], sensitivity[(t - k - 3) % d]
            for p in range(P):
                s[p] += (g1 * s1[p] + g2 * s2[p]) + (g3 * s3[p] + g4 * s4[p])
        for k in range(fours, d):
            g_s = gain[k - 1]
            earlier = sensitivity[(t - k) % d]
            for p in range(P):
                s[p] += g_s * earlier[p]
        for i in range(neurons):
            by_weight = s[i * n_x : (i + 1) * n_x]
            delta_i = delta[i]
            for j in range(n_x):
                by_weight[j] += delta_i * x_s[j]  # df/dW1_ij
            s[neurons * n_x + i] += delta_i  # df/db1_i
            s[neurons * (n_x + 1) + i] += a[i]  # df/dw2_i
        s[P - 1] += 1.0  # df/db2
        w[0] = weight[t]
        w_s = w[0]
        for p in range(P):
            out[c, p] = w_s * s[p]
        out[c, P] = weight[t] * (y - measured[t])
        push(feedback, y)

"""The Gauss-Newton matrix of a NARX network in its series-parallel form, summed without its Jacobian.

Belongs here: the products of pairs and their sums. Never: a closed loop, what the matrix is used for.
With x' = (1, x), delta_i = w2_i (1 - a_i^2), z = (a, 1, error) and a sample's weight w, a row of the Jacobian
and its error are w delta_i x'_j for every i and j, and w z. The products of two of them are
    (w delta_i w delta_k) (x'_j x'_l)    of which N (N + 1) / 2 times (n_x + 1) (n_x + 2) / 2 are distinct,
    (w delta_i w z_k) x'_j    and    w z_i w z_k,
each summed over samples by one matrix product: about half of a symmetric product's multiplications.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from targets.jit import njit
from targets.narx.jacobian import unpacked
from targets.narx.recursion import tanh_all
from targets.narx.threads import mapping

Floats = NDArray[np.float64]

ROWS = 512
"""Samples in a block: 2.5 MiB of float32 at 631 weights, multiplied while it is in the cache."""
LANES = 16
"""The pairs of regressors are padded with zeros to a multiple of this: whole vectors are faster."""


class Paired:
    """Samples of a network of `neurons`, to be summed by matrix products on a torch device.

    v (B, d + L, n_u), measured, weight (B, L), start (B, d): segments, as in `objective.Segments`.
    dtype: of the products; the network itself runs in float64, and blocks are summed in float64.
    """

    def __init__(
        self,
        v: Floats,
        measured: Floats,
        weight: Floats,
        start: Floats,
        neurons: int,
        device: str,
        dtype: Any,
    ) -> None:
        import torch

        self.neurons, self.device, self.dtype = neurons, device, dtype
        self.delays = d = start.shape[1]
        # one time line, segment behind segment, of which only what counts is visited
        past_y = np.concatenate([start[:, ::-1], measured], axis=1)
        past = np.concatenate([v, past_y[:, :, None]], axis=2)
        self.past = np.ascontiguousarray(past.reshape(-1, past.shape[2]).T)
        weights = np.pad(weight, ((0, 0), (d, 0))).ravel()
        at = np.flatnonzero(weights)
        more = -len(at) % ROWS
        self.at = np.pad(at, (0, more), constant_values=d).reshape(-1, ROWS)
        self.weight = np.pad(weights[at], (0, more)).reshape(-1, ROWS)
        self.n = n = len(self.past) * d + 1  # of x'
        pairs, pairs_x = neurons * (neurons + 1) // 2, n * (n + 1) // 2
        pairs_x += -pairs_x % LANES
        self.sizes = (pairs, neurons * (neurons + 2), neurons + 2, pairs_x)
        self.shapes = ((pairs, pairs_x), (n, neurons * (neurons + 2)), (neurons + 2, neurons + 2))
        self.places = torch.from_numpy(_places(neurons, self.shapes)).to(device)

    def errors(self, theta: Floats, threads: int) -> Floats:
        """Weighted errors of theta (P,), of the samples that have a weight."""
        work = (*unpacked(theta, self.neurons), self.delays, self.past)
        errors = np.empty(self.at.shape)
        with mapping(threads) as each:
            list(each(lambda at, error: network(*work, at, error), self.at, errors))
        return errors * self.weight

    def gram(self, theta: Floats, threads: int) -> Any:
        """[J, e]'[J, e] (P + 1, P + 1) of weighted Jacobian and errors at theta (P,), float64."""
        import torch

        # torch allocates them: aligned memory gives products that repeat bit for bit
        rooms = [[torch.zeros(size, ROWS, dtype=self.dtype) for size in self.sizes] for _ in range(threads)]
        views = [[products.numpy() for products in room] for room in rooms]
        work = (*unpacked(theta, self.neurons), self.delays, self.past)
        sums = [torch.zeros(shape, dtype=torch.float64, device=self.device) for shape in self.shapes]
        with mapping(threads) as each:
            for k in range(0, len(self.at), threads):
                blocks = zip(self.at[k : k + threads], self.weight[k : k + threads], views, strict=False)
                filled = list(each(lambda block: fill(*work, *block[:2], *block[2]), blocks))
                for room, _ in zip(rooms, filled, strict=False):
                    deltas, mixed, z, xs = (products.to(self.device) for products in room)
                    sums[0] += deltas @ xs.T
                    sums[1] += xs[: self.n] @ mixed.T
                    sums[2] += z @ z.T
        return torch.cat([part.flatten() for part in sums])[self.places]


def _places(N: int, shapes: tuple[tuple[int, int], ...]) -> NDArray[np.int64]:
    """Where sums of `shapes`, one behind the other, have the products of [J, e]: indices (P + 1, P + 1)."""
    ends = np.cumsum([np.prod(shape) for shape in shapes])
    parts = np.split(np.arange(ends[-1]), ends[:-1])
    pairs, mixed, tail = (part.reshape(shape) for part, shape in zip(parts, shapes, strict=True))
    n = len(mixed)
    head = pairs[_pair_places(N)[:, None, :, None], _pair_places(n)[:, None, :]].reshape(N * n, N * n)
    cross = mixed.reshape(n, N, N + 2).transpose(1, 0, 2).reshape(N * n, N + 2)
    places = np.block([[head, cross], [cross.T, np.maximum(tail, tail.T)]])  # one of two that may round apart
    # so far neuron by neuron, b1_i before its row of W1
    by_neuron = np.arange(N * n).reshape(N, n)
    order = np.concatenate([by_neuron[:, 1:].ravel(), by_neuron[:, 0], np.arange(N * n, len(places))])
    return places[np.ix_(order, order)]


def _pair_places(n: int) -> NDArray[np.int64]:
    """Where `pair` writes the product of rows j and k: (n, n)."""
    j, k = np.triu_indices(n)
    places = np.empty((n, n), np.int64)
    places[j, k] = places[k, j] = np.arange(len(j))
    return places


@njit(cache=True, nogil=True)
def scale(x, rows, out):  # type: ignore[no-untyped-def]
    """Write x (R,) times each of `rows` (K, R) to out (K, R)."""
    for k in range(rows.shape[0]):
        for r in range(x.shape[0]):
            out[k, r] = x[r] * rows[k, r]


@njit(cache=True, nogil=True)
def pair(rows, out):  # type: ignore[no-untyped-def]
    """Write the product of every two of `rows` (K, R), j <= k, to the head of out (.., R), j by j."""
    end = 0
    for j in range(rows.shape[0]):
        begin, end = end, end + rows.shape[0] - j
        scale(rows[j], rows[j:], out[begin:end])


@njit(cache=True, nogil=True)
def network(W1, b1, w2, b2, d, past, at, error):  # type: ignore[no-untyped-def]
    """Write the errors of the samples at indices `at` (R,) of `past` (n_u + 1, T), the output last.

    Returns x (n_x, R) and a (N, R). Unlike in a closed loop, samples can stand side by side: every loop here
    runs over them.
    """
    N, n_x = W1.shape
    R = at.shape[0]
    x = np.empty((n_x, R))
    for j in range(n_x):
        for r in range(R):
            x[j, r] = past[j // d, at[r] - 1 - j % d]
    for r in range(R):
        error[r] = b2 - past[-1, at[r]]
    a = np.empty((N, R))
    whole = n_x // 4 * 4
    for i in range(N):
        # a = tanh(W1 x + b1), by four as in `recursion.layer`
        a_i = a[i]
        a_i[:] = b1[i]
        for j in range(0, whole, 4):
            for r in range(R):
                a_i[r] += (W1[i, j] * x[j, r] + W1[i, j + 1] * x[j + 1, r]) + (
                    W1[i, j + 2] * x[j + 2, r] + W1[i, j + 3] * x[j + 3, r]
                )
        for j in range(whole, n_x):
            for r in range(R):
                a_i[r] += W1[i, j] * x[j, r]
        tanh_all(a_i)
        # y = w2 . a + b2
        for r in range(R):
            error[r] += w2[i] * a_i[r]
    return x, a


@njit(cache=True, nogil=True)
def fill(W1, b1, w2, b2, d, past, at, weight, deltas, mixed, z, xs):  # type: ignore[no-untyped-def]
    """Write the pairs of the samples at indices `at` (R,), of `weight` (R,).

    deltas (N (N + 1) / 2, R), mixed (N (N + 2), R), z (N + 2, R), xs ((n_x + 1) (n_x + 2) / 2 and more, R):
    w delta_i w delta_k; w delta_i w z_k; w z; x'_j x'_k, of which the first n_x + 1 are x'.
    """
    R = at.shape[0]
    error = np.empty(R)
    x, a = network(W1, b1, w2, b2, d, past, at, error)
    N, n_x = W1.shape
    delta = np.empty((N, R), deltas.dtype)
    for i in range(N):
        for r in range(R):
            delta[i, r] = weight[r] * (w2[i] * (1.0 - a[i, r] * a[i, r]))
            z[i, r] = weight[r] * a[i, r]
    for r in range(R):
        z[N, r] = weight[r]
        z[N + 1, r] = weight[r] * error[r]
    one_x = np.ones((n_x + 1, R), xs.dtype)
    one_x[1:] = x
    pair(delta, deltas)
    for i in range(N):
        scale(delta[i], z, mixed[i * (N + 2) : (i + 1) * (N + 2)])
    pair(one_x, xs)

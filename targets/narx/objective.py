"""The squared error of a NARX network over segments of rides, and its Gauss-Newton matrix.

Belongs here: cutting sequences into segments, the cost, the normal equations, accumulated in blocks.
Never: a decision on what to do with them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from targets.errors import TrainingError
from targets.narx.jacobian import rows, unpacked
from targets.narx.paired import Paired
from targets.narx.recursion import forward, packed
from targets.narx.threads import mapping

Floats = NDArray[np.float64]

BLOCK_ROWS = 6144
"""Jacobian rows held at once: 15 MiB of float32 at 631 weights, past which products gain no speed."""
STEPS = 512
"""Most samples a segment advances per block, so that many segments share one."""
PANEL = 128
"""Columns of a panel of the symmetric product, whose mirror images are left out; whole vectors are faster."""


@dataclass(frozen=True, eq=False)
class Segments:
    """Stretches of equal length, in normalised units, the recursion starting anew in each.

    v (B, d + L, n_u): inputs behind d samples of history; measured, weight (B, L);
    start (B, d): outputs before the first sample, the most recent first.
    """

    v: Floats
    measured: Floats
    weight: Floats
    start: Floats

    def taken(self, which: NDArray[np.intp]) -> "Segments":
        """Return the segments at the indices `which`."""
        return Segments(self.v[which], self.measured[which], self.weight[which], self.start[which])


def cut(
    runs: list[tuple[Floats, Floats, Floats]], d: int, initial: float, washout: int, length: int
) -> Segments:
    """Cut normalised runs (v (T, n_u), y (T,), weight (T,)) into segments of `length` samples.

    The first `washout` samples of a run get weight 0: the delay lines start from `initial` there, and
    from what was measured in later segments. A run's last segment is filled up with weight 0.
    """
    pieces = []
    for u, y, weight in runs:
        past_u = np.concatenate([np.repeat(u[:1], d, axis=0), u])
        past_y = np.concatenate([np.full(d, initial), y])
        counted = np.where(np.arange(len(y)) < washout, 0.0, weight)
        for begin in range(0, len(y), length):
            missing = max(0, begin + length - len(y))
            end = begin + length - missing
            pieces.append(
                (
                    np.pad(past_u[begin : end + d], ((0, missing), (0, 0)), mode="edge"),
                    np.pad(y[begin:end], (0, missing), mode="edge"),
                    np.pad(counted[begin:end], (0, missing)),
                    past_y[begin : begin + d][::-1],
                )
            )
    return Segments(*(np.ascontiguousarray(np.stack(column)) for column in zip(*pieces, strict=True)))


class Objective:
    """Mean weighted squared error of theta over `segments`, plus decay * |theta|^2.

    closed: the parallel form, else the series-parallel form. device: where torch multiplies matrices
    ("cpu", "cuda"); the recursion always runs on the CPU, one segment a thread. single: Jacobian blocks
    in float32, summed over blocks in float64; the cost itself is always float64.
    Sums run in a fixed order: equal inputs give equal bytes on one machine with one number of threads.
    """

    def __init__(
        self, segments: Segments, neurons: int, closed: bool, decay: float, device: str, single: bool
    ) -> None:
        self.torch = load_torch(device)
        self.segments, self.neurons, self.decay = segments, neurons, decay
        self.device = device
        self.dtype = self.torch.float32 if single else self.torch.float64
        self.scale = 1.0 / float(np.sum(segments.weight**2))
        self.threads = int(self.torch.get_num_threads())
        s = segments
        self.paired = (
            None if closed else Paired(s.v, s.measured, s.weight, s.start, neurons, device, self.dtype)
        )

    def cost(self, theta: Floats) -> float:
        """Return the objective at theta (P,)."""
        return float(self.scale * np.sum(self.errors(theta) ** 2) + self.decay * theta @ theta)

    def errors(self, theta: Floats) -> Floats:
        """Weighted errors of theta, in normalised units, of at least what has a weight."""
        if self.paired:
            return self.paired.errors(theta, self.threads)
        W1, b1, w2, b2 = unpacked(theta, self.neurons)
        network = (*packed(W1, b1, w2), b2)
        s = self.segments
        y = np.empty_like(s.measured)

        def run(k: int) -> None:
            forward(*network, s.v[k], s.start[k], True, s.measured[k], y[k])

        with mapping(self.threads) as each:
            list(each(run, range(len(y))))
        return s.weight * (y - s.measured)

    def normal(self, theta: Floats) -> tuple[Any, Any]:
        """Gauss-Newton matrix (P, P) and half gradient (P,) at theta: float64 tensors on the device."""
        P = theta.size
        total = (self.paired.gram(theta, self.threads) if self.paired else self._gram(theta)) * self.scale
        point = self.torch.from_numpy(theta).to(self.device)
        total[:P, :P].diagonal().add_(self.decay)
        return total[:P, :P], total[:P, P] + self.decay * point

    def _gram(self, theta: Floats) -> Any:
        """[J, e]'[J, e] (P + 1, P + 1) of the parallel form, by panels of columns."""
        size = theta.size + 1
        total = self.torch.zeros(size, size, dtype=self.torch.float64, device=self.device)
        for block in self._blocks(theta):
            J = block.to(self.device)
            for begin in range(0, size, PANEL):
                panel = slice(begin, begin + PANEL)
                total[begin:, panel] += J[:, begin:].T @ J[:, panel]
        return total.tril() + total.tril(-1).T

    def _blocks(self, theta: Floats) -> Iterator[Any]:
        """Yield Jacobian blocks (rows, P + 1), the weighted error in the last column."""
        torch = self.torch
        s = self.segments
        count, length = s.measured.shape
        d = s.start.shape[1]
        W1, b1, w2, b2 = unpacked(theta, self.neurons)
        network = (*packed(W1, b1, w2), b2)
        steps = -(-length // -(-length // STEPS))  # equal shares, so that few rows are past the end
        group = min(count, max(1, BLOCK_ROWS // steps))
        # torch allocates it: aligned memory gives products that repeat bit for bit
        block = torch.empty(group, steps, theta.size + 1, dtype=self.dtype)
        out = block.numpy()
        with mapping(self.threads) as each:
            for first in range(0, count, group):
                which = range(first, min(first + group, count))
                states = [(s.start[k].copy(), np.zeros((d, theta.size), out.dtype)) for k in which]
                for begin in range(0, length, steps):
                    work = [
                        (s.v[k], s.measured[k], s.weight[k], begin, *state, into)
                        for k, state, into in zip(which, states, out, strict=False)
                    ]
                    list(each(lambda args: rows(*network, self.neurons, *args), work))
                    yield block[: len(work)].reshape(-1, theta.size + 1)


def load_torch(device: str) -> Any:
    """Import torch, which only training needs, and see that it has `device`.

    Raises TrainingError that says how to install it, or what is wrong with the device.
    """
    try:
        import torch
    except ImportError:
        raise TrainingError("training needs PyTorch: pip install 'strokebench[train]'") from None
    try:
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:  # the latter from builds without CUDA
        raise TrainingError(f"device {device}: {str(error).splitlines()[0]}") from None
    return torch

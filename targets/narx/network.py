"""The NARX network of section III.3: weights, ranges, and what it predicts.

Belongs here: the network as deployed, on plain arrays in physical units. Never: training, a file format.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike

from targets.errors import CalibrationError
from targets.narx.prepare import Floats, Range, normalised, physical
from targets.narx.recursion import forward, packed


@dataclass(frozen=True, eq=False)
class Narx:
    """A NARX network with one tansig layer and one linear output (eq. III.1, Appendix I).

    y(t) = w2 . tanh(W1 x + b1) + b2 in normalised units, with
    x = [u1(t-1) .. u1(t-d), u2(t-1) .., ..., y(t-1) .. y(t-d)]: each input's lags, then the output's.

    inputs, output: channel names, units in them; y(t) is `output` at t + shift samples.
    delays: d, in samples at rate_hz. input_ranges, output_range: (lo, hi), mapped to [-1, 1].
    W1 (N, (n_u + 1) d), b1 (N,), w2 (N,) and b2: float64, read-only, in normalised units.
    initial_mm: what the delay line of the fed-back output starts from (static equilibrium), in the
    output's unit; the delay lines of the inputs start filled with the first sample.
    Raises CalibrationError for shapes that do not fit, values that are not finite, or empty ranges.
    """

    inputs: tuple[str, ...]
    output: str
    delays: int
    input_ranges: tuple[Range, ...]
    output_range: Range
    W1: Floats
    b1: Floats
    w2: Floats
    b2: float
    initial_mm: float
    shift: int = 0
    rate_hz: float = 100.0

    def __post_init__(self) -> None:
        if not self.inputs or len(set(self.inputs)) < len(self.inputs):
            raise CalibrationError(f"network inputs {self.inputs}: one or more distinct channels are needed")
        if self.delays < 1 or self.shift < 0:
            raise CalibrationError(f"network delays {self.delays}, shift {self.shift}: at least 1 and 0")
        if len(self.input_ranges) != len(self.inputs):
            raise CalibrationError(f"network has {len(self.inputs)} inputs, {len(self.input_ranges)} ranges")
        for name, (lo, hi) in zip((*self.inputs, self.output), self._ranges, strict=True):
            if not (np.isfinite(lo) and np.isfinite(hi) and lo < hi):
                raise CalibrationError(f"range of {name} is ({lo}, {hi})")
        neurons = np.size(self.b1)
        shapes = {"W1": (neurons, (len(self.inputs) + 1) * self.delays), "b1": (neurons,), "w2": (neurons,)}
        for name, shape in shapes.items():
            array = np.array(getattr(self, name), dtype=np.float64)
            if array.shape != shape or neurons == 0:
                raise CalibrationError(f"network {name} has shape {array.shape}, {shape} was expected")
            if not np.isfinite(array).all():
                raise CalibrationError(f"network {name} holds a value that is not finite")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        for name in ("b2", "initial_mm"):
            value = float(getattr(self, name))
            if not np.isfinite(value):
                raise CalibrationError(f"network {name} is {value}")
            object.__setattr__(self, name, value)

    @property
    def _ranges(self) -> tuple[Range, ...]:
        return (*self.input_ranges, self.output_range)

    @property
    def neurons(self) -> int:
        """N, neurons of the hidden layer."""
        return self.b1.size

    def free_run(self, u: ArrayLike) -> Floats:
        """Predict the output from the inputs alone: the parallel form (figure Appendix I.2).

        u: (T, n_u), physical units, columns in the order of `inputs`. Returns (T,) in the output's unit.
        Raises CalibrationError for another number of columns or values that are not finite.
        """
        v = self._padded(u)
        y = np.empty(len(v) - self.delays)
        start = np.full(self.delays, float(normalised(self.initial_mm, self.output_range)))
        forward(*packed(self.W1, self.b1, self.w2), self.b2, v, start, True, y, y)
        return physical(y, self.output_range)

    def one_step(self, u: ArrayLike, y: ArrayLike) -> Floats:
        """Predict each sample from the outputs given before it: the series-parallel form (figure I.3).

        u: (T, n_u) and y: (T,), physical units, y already shifted by `shift`. Returns (T,).
        Raises CalibrationError as `free_run`, and for a `y` of another length.
        """
        v = self._padded(u)
        d = self.delays
        fed = np.asarray(y, dtype=np.float64)
        if fed.shape != (len(v) - d,):
            raise CalibrationError(
                f"{self.output} has shape {fed.shape} beside inputs of {len(v) - d} samples"
            )
        if not np.isfinite(fed).all():
            raise CalibrationError(f"{self.output} holds a value that is not finite")
        fed = normalised(np.concatenate([np.full(d, self.initial_mm), fed]), self.output_range)
        hidden = np.tile(self.b1, (len(v) - d, 1))
        for j, line in enumerate((*v.T, fed)):
            # a window ends at t-1 and runs forward in time, a delay line runs backward
            lags = sliding_window_view(line[:-1], d)[:, ::-1]
            hidden += lags @ self.W1[:, j * d : (j + 1) * d].T
        return physical(np.tanh(hidden) @ self.w2 + self.b2, self.output_range)

    def rounded(self) -> "Narx":
        """Return this network with every weight a float32 value: the one that is deployed."""

        def single(values: Floats) -> Floats:
            return values.astype(np.float32).astype(np.float64)

        return replace(
            self, W1=single(self.W1), b1=single(self.b1), w2=single(self.w2), b2=float(np.float32(self.b2))
        )

    def _padded(self, u: ArrayLike) -> Floats:
        """Normalise (T, n_u) inputs and put `delays` copies of the first sample before them."""
        values = np.asarray(u, dtype=np.float64)
        if values.ndim != 2 or values.shape[1] != len(self.inputs) or not len(values):
            raise CalibrationError(
                f"inputs of shape {values.shape}: (samples, {len(self.inputs)}) was expected, "
                f"for {', '.join(self.inputs)}"
            )
        if not np.isfinite(values).all():
            bad = self.inputs[int(np.argwhere(~np.isfinite(values))[0][1])]
            raise CalibrationError(f"{bad} holds a value that is not finite")
        columns = [normalised(values[:, j], span) for j, span in enumerate(self.input_ranges)]
        v = np.stack(columns, axis=1)
        return np.concatenate([np.repeat(v[:1], self.delays, axis=0), v])

"""The NARX network in torch, double precision: the reference that firmware is held to (section V.5, STEP 5).

Belongs here: both forms, which share one module (Figure III.5), as the equations stand. Never: speed;
`recursion` is what runs.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from targets.narx.network import Narx
from targets.narx.objective import load_torch
from targets.narx.prepare import normalised, physical

Floats = NDArray[np.float64]


def module(narx: Narx) -> Any:
    """The network as a torch module, float64: regressors (T, n_x) in, normalised outputs (T,) out.

    y = w2 tansig(W1 x + b1) + b2 (III.1); a regressor is what `regressors` makes.
    """
    torch = load_torch("cpu")
    neurons, n_x = narx.W1.shape
    hidden, out = torch.nn.Linear(n_x, neurons), torch.nn.Linear(neurons, 1)
    net = torch.nn.Sequential(hidden, torch.nn.Tanh(), out, torch.nn.Flatten(0)).double()
    with torch.no_grad():
        for parameter, values in zip(
            net.parameters(), (narx.W1, narx.b1, narx.w2[None, :], np.array([narx.b2])), strict=True
        ):
            parameter.copy_(torch.from_numpy(np.array(values, dtype=np.float64)))
    return net.requires_grad_(False)


def series_parallel(narx: Narx, u: Floats, y: Floats) -> Floats:
    """One-step predictions (T,) in physical units from inputs u (T, n_u) and the measured outputs y (T,)."""
    torch = load_torch("cpu")
    v = _inputs(narx, u)
    past = np.concatenate([np.full(narx.delays, _initial(narx)), normalised(y, narx.output_range)])
    rows = [
        np.concatenate([_taps(v, t, narx.delays), past[t : t + narx.delays][::-1]]) for t in range(len(u))
    ]
    return physical(module(narx)(torch.from_numpy(np.array(rows))).numpy(), narx.output_range)


def parallel(narx: Narx, u: Floats) -> Floats:
    """Free run (T,) in physical units from inputs u (T, n_u): its own outputs fed back."""
    torch = load_torch("cpu")
    net, v, d = module(narx), _inputs(narx, u), narx.delays
    regressor = torch.zeros(1, narx.W1.shape[1], dtype=torch.float64)
    fed_back = regressor[0, -d:]
    fed_back.fill_(_initial(narx))
    taps = torch.from_numpy(np.array([_taps(v, t, d) for t in range(len(u))]))
    out = np.empty(len(u))
    for t in range(len(u)):
        regressor[0, :-d] = taps[t]
        y = net(regressor)
        out[t] = float(y)
        fed_back[1:] = fed_back[:-1].clone()
        fed_back[0] = y[0]
    return physical(out, narx.output_range)


def _inputs(narx: Narx, u: Floats) -> Floats:
    """Normalised inputs (d + T, n_u), the first repeated where there is no history."""
    columns = [normalised(u[:, j], span) for j, span in enumerate(narx.input_ranges)]
    v = np.stack(columns, axis=1)
    return np.concatenate([np.repeat(v[:1], narx.delays, axis=0), v])


def _taps(v: Floats, t: int, d: int) -> Floats:
    """Each input at the d samples before t, the most recent first, input by input."""
    return v[t : t + d][::-1].T.ravel()


def _initial(narx: Narx) -> float:
    return float(normalised(narx.initial_mm, narx.output_range))

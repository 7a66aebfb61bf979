import numpy as np
import pytest

from targets.errors import CalibrationError
from targets.narx.network import Narx
from targets.narx.recursion import tanh_all


def inputs(samples: int = 60, seed: int = 3) -> np.ndarray:
    rng = np.random.Generator(np.random.PCG64(seed))
    return np.stack([rng.uniform(0.0, 150.0, samples), rng.uniform(0.0, 200.0, samples)], axis=1)


def by_the_equation(network: Narx, u: np.ndarray, fed: np.ndarray | None = None) -> np.ndarray:
    """Equation III.1, sample by sample, lag by lag."""
    d = network.delays

    def scaled(value, span):
        return 2.0 * (value - span[0]) / (span[1] - span[0]) - 1.0

    lo, hi = network.output_range
    y = []
    for t in range(len(u)):
        x = []
        for j, span in enumerate(network.input_ranges):
            x += [scaled(u[max(t - k, 0), j], span) for k in range(1, d + 1)]
        past = y if fed is None else fed
        x += [scaled(past[t - k] if t >= k else network.initial_mm, (lo, hi)) for k in range(1, d + 1)]
        hidden = [
            np.tanh(sum(w * v for w, v in zip(row, x, strict=True)) + b)
            for row, b in zip(network.W1, network.b1, strict=True)
        ]
        out = sum(w * a for w, a in zip(network.w2, hidden, strict=True)) + network.b2
        y.append(lo + (out + 1.0) * (hi - lo) / 2.0)
    return np.array(y)


@pytest.mark.parametrize(("neurons", "delays"), [(5, 3), (15, 10), (8, 1), (1, 2)])
def test_free_run(network, neurons, delays):
    """The free run is equation III.1 with the network's own outputs fed back."""
    net = network(neurons=neurons, delays=delays, size=0.2)
    u = inputs()
    assert np.allclose(net.free_run(u), by_the_equation(net, u), rtol=0.0, atol=1e-9)


def test_one_step(network):
    """The one-step prediction is equation III.1 with the given outputs fed back."""
    net = network()
    u, fed = inputs(), np.random.default_rng(4).uniform(20.0, 60.0, 60)
    assert np.allclose(net.one_step(u, fed), by_the_equation(net, u, fed), rtol=0.0, atol=1e-9)


def test_one_step_of_own_outputs(network):
    """One-step prediction from the free run's own outputs is the free run."""
    net = network(seed=2, neurons=15, delays=10, size=0.2)
    u = inputs(500)
    y = net.free_run(u)
    assert np.ptp(y) > 1.0
    assert np.allclose(net.one_step(u, y), y, rtol=0.0, atol=1e-9)


def test_output_lag_that_is_read(network):
    """A weight on the last input block, third place, reads the output of three samples before."""
    net = network(neurons=1, delays=4)
    W1 = np.zeros((1, 12))
    W1[0, 2 * 4 + 2] = 1e-3  # small: tanh is linear there
    net = Narx(
        net.inputs, net.output, 4, net.input_ranges, net.output_range, W1, [0.0], [1e3], 0.0, net.initial_mm
    )
    fed = np.linspace(40.0, 60.0, 20)
    assert np.allclose(net.one_step(inputs(20), fed)[3:], fed[:-3], atol=1e-3)


def test_rounded(network):
    """A rounded network holds float32 values only and predicts nearly the same."""
    net = network(size=0.2)
    single = net.rounded()
    for values in (single.W1, single.b1, single.w2, np.array(single.b2)):
        assert np.array_equal(values, values.astype(np.float32))
    assert not np.array_equal(single.W1, net.W1)
    assert np.allclose(single.free_run(inputs()), net.free_run(inputs()), atol=1e-4)


def test_weight_count(network):
    """The thesis's network, three inputs, 15 neurons, 10 delays, has 631 weights."""
    ranges = ((0.0, 1.0),) * 3
    net = Narx(
        ("a", "b", "c"), "y", 10, ranges, (0.0, 1.0), np.zeros((15, 40)), np.zeros(15), np.zeros(15), 0.0, 0.5
    )
    assert sum(part.size for part in (net.W1, net.b1, net.w2)) + 1 == 631


def test_weights_are_frozen(network):
    """The weights of a network cannot be written to."""
    with pytest.raises(ValueError, match="read-only"):
        network().W1[0, 0] = 1.0


def test_tanh():
    """The compiled tangent is libm's within 1e-14, saturates at 1, and keeps NaN."""
    x = np.concatenate([np.linspace(-30.0, 30.0, 20001), [0.0, 1e-12, 1e300, -np.inf]])
    y = x.copy()
    tanh_all(y)
    assert np.max(np.abs(y - np.tanh(x))) < 1e-14
    lost = np.array([np.nan])
    tanh_all(lost)
    assert np.isnan(lost[0])


@pytest.mark.parametrize(
    ("u", "says"),
    [
        (np.zeros((5, 3)), "inputs of shape (5, 3)"),
        (np.zeros(5), "inputs of shape (5,)"),
        (np.zeros((0, 2)), "inputs of shape (0, 2)"),
        (np.array([[1.0, 2.0], [1.0, np.nan]]), "speed_kmh holds"),
    ],
)
def test_unfit_inputs(network, u, says):
    """Inputs of another shape or with NaN are refused by name."""
    with pytest.raises(CalibrationError) as refusal:
        network().free_run(u)
    assert says in str(refusal.value)


@pytest.mark.parametrize("y", [np.zeros(4), np.array([1.0, np.inf, 1.0, 1.0, 1.0])])
def test_unfit_outputs(network, y):
    """Outputs to feed back that do not match the inputs, or are not finite, are refused by name."""
    with pytest.raises(CalibrationError, match="rear_stroke_mm"):
        network().one_step(np.zeros((5, 2)), y)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"W1": np.zeros((5, 8))}, "W1 has shape"),
        ({"w2": np.zeros(4)}, "w2 has shape"),
        ({"b1": np.full(5, np.nan)}, "b1 holds"),
        ({"b2": np.inf}, "b2 is inf"),
        ({"initial_mm": np.nan}, "initial_mm is nan"),
        ({"output_range": (5.0, 5.0)}, "range of rear_stroke_mm"),
        ({"input_ranges": ((0.0, 1.0),)}, "2 inputs, 1 ranges"),
        ({"inputs": ("a", "a")}, "distinct"),
        ({"delays": 0}, "delays 0"),
        ({"shift": -1}, "shift -1"),
    ],
)
def test_unfit_network(network, change, says):
    """Weights, ranges and names that do not fit together make no network."""
    good = network()
    fields = {name: getattr(good, name) for name in good.__dataclass_fields__}
    with pytest.raises(CalibrationError) as refusal:
        Narx(**{**fields, **change})
    assert says in str(refusal.value)

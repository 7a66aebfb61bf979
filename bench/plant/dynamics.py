"""Equations of motion of the half-car and their integrator: heave, pitch and two wheels on a road.

Belongs here: forces, accelerations, time stepping. Never: where the road or the speed come from.

Heights point up and are zero with both struts fully extended and both tyres just touching a road at zero;
pitch is positive nose down, as in equation (II.1).

FIDELITY: in-plane and small angles: no roll, no steering; height of the centre of gravity and wheelbase are
constant; the wheels' fore-and-aft inertia is lumped into the body. The dampers are passive: the thesis's
Magneto system (I.5) varies them. The rider is part of the body.

Compiled without fast-math and in one thread: the same
input gives the same bytes.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.plant.motorcycle import Motorcycle, Strut, Tyre
from targets.jit import njit

GRAVITY_M_PER_S2 = 9.80665
DEGREES_PER_RADIAN = 57.29577951308232
SUBSTEPS = 2  # 0.5 ms: halving it moves no stroke by 0.05 mm rms (tested)
COLUMNS = (
    "fork_stroke_mm",
    "rear_stroke_mm",
    "pitch_rate_dps",
    "acc_front_ms2",
    "acc_rear_ms2",
    "acc_body_ms2",
    "front_tyre_n",
    "rear_tyre_n",
)
"""Columns of `simulate`'s result; accelerations are vertical and kinematic, zero at rest."""


@njit(cache=True)
def element_force(strut: Strut, u: float) -> float:
    """Static force of a fork leg or shock compressed by `u` metres, in newtons, extending positive."""
    force = strut.preload_n + strut.spring_n_per_m * u
    # isothermal air column: p A (L / (L - u) - 1)
    force += strut.air_n * u / (strut.air_length_m - u)
    if u > strut.bump_m:
        force += strut.bump_n_per_m2 * (u - strut.bump_m) ** 2
    if u < strut.topout_m:
        force -= strut.topout_n_per_m2 * (strut.topout_m - u) ** 2
    return force


@njit(cache=True)
def wheel_force(strut: Strut, w: float, w_dot: float) -> float:
    """Vertical force at the wheel of a strut, in newtons, for wheel travel `w` (m) and its speed (m/s)."""
    ratio = strut.linkage + strut.linkage_rise_per_m * w
    u = (strut.linkage + 0.5 * strut.linkage_rise_per_m * w) * w
    u_dot = ratio * w_dot
    speed = abs(u_dot)
    if u_dot > 0.0:
        slow, fast = strut.compression_ns_per_m, strut.compression_fast_ns_per_m
    else:
        slow, fast = strut.rebound_ns_per_m, strut.rebound_fast_ns_per_m
    # digressive damper: c(v) = c_fast + (c_slow - c_fast) / (1 + |v| / v_knee)
    damping = fast + (slow - fast) * strut.knee_m_per_s / (strut.knee_m_per_s + speed)
    # FIDELITY: seals slide from the first micrometre, they never stick
    friction = strut.friction_n / (strut.friction_m_per_s + speed)
    # virtual work: F_wheel dw = F_element du
    return ratio * (element_force(strut, u) + (damping + friction) * u_dot)


@njit(cache=True)
def tyre_force(tyre: Tyre, deflection: float, deflection_speed: float) -> float:
    """Force of the road on the wheel, in newtons: k d (1 + lambda d'), zero in the air, never negative.

    FIDELITY: one point of contact, stiffness constant over speed and load.
    """
    if deflection <= 0.0:
        return 0.0
    return max(0.0, tyre.stiffness_n_per_m * deflection * (1.0 + tyre.damping_s_per_m * deflection_speed))


@njit(cache=True)
def accelerate(m: Motorcycle, y: Any, ground: Any, push_n: float, moment_nm: float, dy: Any) -> None:
    """Write the time derivative of the state `y` to `dy`.

    y: heave, pitch, front wheel, rear wheel (m, rad), then their speeds. ground: road height under front and
    rear wheel (m), then its rate of change (m/s). push_n: force of the road along the road, driving
    positive. moment_nm: what pitches the body nose up. dy gets, after the 8 derivatives, both tyre forces.
    """
    front_travel = y[2] - (y[0] - m.to_front_m * y[1])
    rear_travel = y[3] - (y[0] + m.to_rear_m * y[1])
    front_speed = y[6] - (y[4] - m.to_front_m * y[5])
    rear_speed = y[7] - (y[4] + m.to_rear_m * y[5])
    front = wheel_force(m.fork, front_travel, front_speed)
    rear = wheel_force(m.shock, rear_travel, rear_speed)
    # The part of the longitudinal forces that links and legs carry past the springs.
    # FIDELITY: constant ratios; chain and swingarm angles change with travel on a real motorcycle.
    if push_n < 0.0:
        front += m.dive_ratio * m.front_brake_share * push_n
        rear += m.squat_ratio * (1.0 - m.front_brake_share) * push_n
    else:
        rear += m.squat_ratio * push_n
    front_load = tyre_force(m.front_tyre, ground[0] - y[2], ground[2] - y[6])
    rear_load = tyre_force(m.rear_tyre, ground[1] - y[3], ground[3] - y[7])
    for i in range(4):  # a slice assignment would cost a second of compilation
        dy[i] = y[i + 4]
    dy[4] = (front + rear) / m.sprung_kg - GRAVITY_M_PER_S2
    dy[5] = (m.to_rear_m * rear - m.to_front_m * front - moment_nm) / m.pitch_inertia_kgm2
    dy[6] = (front_load - front) / m.front_kg - GRAVITY_M_PER_S2
    dy[7] = (rear_load - rear) / m.rear_kg - GRAVITY_M_PER_S2
    dy[8] = front_load
    dy[9] = rear_load


@njit(cache=True)
def _look(height: Any, per_m: float, x: float, speed: float, ground: Any, wheel: int) -> None:
    """Read the road under one wheel: linear between samples."""
    place = x * per_m
    i = int(place)
    rise = height[i + 1] - height[i]
    ground[wheel] = height[i] + (place - i) * rise
    ground[wheel + 2] = rise * per_m * speed


@njit(cache=True)
def _write(m: Motorcycle, y: Any, dy: Any, row: Any) -> None:
    """Write one sample, columns as in COLUMNS, from state and derivatives."""
    front = y[2] - (y[0] - m.to_front_m * y[1])
    rear = y[3] - (y[0] + m.to_rear_m * y[1])
    row[0] = 1e3 * (m.fork.sensor + 0.5 * m.fork.sensor_rise_per_m * front) * front
    row[1] = 1e3 * (m.shock.sensor + 0.5 * m.shock.sensor_rise_per_m * rear) * rear
    row[2] = y[5] * DEGREES_PER_RADIAN
    row[3] = dy[6]
    row[4] = dy[7]
    row[5] = dy[4] - m.body_sensor_m * dy[5]
    row[6] = dy[8]
    row[7] = dy[9]


@njit(cache=True)
def _integrate(m: Motorcycle, y: Any, height: Any, per_m: float, way: Any, substeps: int, out: Any) -> None:
    """Classical Runge-Kutta; `way` holds place, speed, push and moment (4, samples), linear in between."""
    wheelbase = m.to_front_m + m.to_rear_m
    h = 0.001 / substeps
    slope = np.zeros((4, 10))
    ground = np.empty(4)
    stage = np.empty(8)
    now = np.empty(4)
    for k in range(way.shape[1]):
        after = min(k + 1, way.shape[1] - 1)
        for part in range(substeps):
            for q in range(4):
                # stages at 0, h/2, h/2, h
                ahead = 0.0 if q == 0 else (1.0 if q == 3 else 0.5)
                f = (part + ahead) / substeps
                for i in range(4):
                    now[i] = way[i, k] + f * (way[i, after] - way[i, k])
                _look(height, per_m, now[0] + wheelbase, now[1], ground, 0)
                _look(height, per_m, now[0], now[1], ground, 1)
                for i in range(8):
                    stage[i] = y[i] + ahead * h * slope[q - 1, i]
                accelerate(m, stage, ground, now[2], now[3], slope[q])
                if q == 0 and part == 0:
                    _write(m, y, slope[0], out[k])
            for i in range(8):
                y[i] += h / 6.0 * (slope[0, i] + 2.0 * (slope[1, i] + slope[2, i]) + slope[3, i])


def equilibrium(motorcycle: Motorcycle, push_n: float = 0.0, moment_nm: float = 0.0) -> NDArray[np.float64]:
    """State (8,) at rest or in steady running on a flat road at height zero."""
    m = motorcycle
    weight = m.sprung_kg * GRAVITY_M_PER_S2
    front_load = (weight * m.to_rear_m - moment_nm) / m.wheelbase_m
    rear_load = weight - front_load
    back = min(push_n, 0.0)
    front = _sag(m.fork, front_load - m.dive_ratio * m.front_brake_share * back)
    rear = _sag(m.shock, rear_load - m.squat_ratio * (max(push_n, 0.0) + (1.0 - m.front_brake_share) * back))
    front_wheel = -(front_load + m.front_kg * GRAVITY_M_PER_S2) / m.front_tyre.stiffness_n_per_m
    rear_wheel = -(rear_load + m.rear_kg * GRAVITY_M_PER_S2) / m.rear_tyre.stiffness_n_per_m
    nose, tail = front_wheel - front, rear_wheel - rear
    pitch = (tail - nose) / m.wheelbase_m
    return np.array([nose + m.to_front_m * pitch, pitch, front_wheel, rear_wheel, 0.0, 0.0, 0.0, 0.0])


def _sag(strut: Strut, load_n: float) -> float:
    """Wheel travel at which a strut at rest carries `load_n`, by bisection."""
    low, high = 0.0, strut.air_length_m * 0.5 / strut.linkage
    for _ in range(60):
        middle = 0.5 * (low + high)
        if wheel_force(strut, middle, 0.0) < load_n:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def simulate(
    motorcycle: Motorcycle,
    height_m: NDArray[np.float64],
    step_m: float,
    x_m: NDArray[np.float64],
    v_mps: NDArray[np.float64],
    push_n: NDArray[np.float64],
    moment_nm: NDArray[np.float64],
    substeps: int = SUBSTEPS,
) -> NDArray[np.float64]:
    """Drive the motorcycle over a road, from the equilibrium of the first sample.

    height_m: road every `step_m`, from where the rear wheel starts (there it must be zero) to beyond the
    front wheel's end. x_m, v_mps, push_n, moment_nm: (samples,) at 1 kHz: rear wheel's place on the road,
    speed, longitudinal road force, moment pitching the body nose up.
    Returns (samples, 8), columns as in COLUMNS.
    """
    out = np.empty((len(x_m), len(COLUMNS)))
    state = equilibrium(motorcycle, push_n[0], moment_nm[0])
    way = np.stack([x_m, v_mps, push_n, moment_nm])
    _integrate(motorcycle, state, height_m, 1.0 / step_m, way, substeps, out)
    return out

"""Equations of motion of the half-car and their integrator: heave, pitch, two wheels and the rider on a road.

Belongs here: forces, accelerations, time stepping. Never: where the road or the speed come from.

Heights point up and are zero with both struts fully extended and both tyres just touching a road at zero;
pitch is positive nose down, as in equation (II.1).

FIDELITY: in-plane and small angles: no steering; a lean only adds to gravity. Height of the centre of gravity
and wheelbase are constant; the wheels' fore-and-aft inertia is lumped into the body.

Compiled without fast-math and in one thread: the same input gives the same bytes.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.plant.motorcycle import LEAST_A, MOST_A, Motorcycle, Strut, Tyre
from targets.jit import njit

GRAVITY_M_PER_S2 = 9.80665
DEGREES_PER_RADIAN = 57.29577951308232
TURN = 6.283185307179586
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
    "front_a",
    "rear_a",
)
"""Columns of `simulate`'s result; accelerations are vertical and kinematic, zero at rest; `_a`: amperes."""

WAY = ("x_m", "v_mps", "push_n", "moment_nm", "weight", "damper")
"""Rows of what `simulate` is driven with."""

SPEED = 5
"""Where the state's speeds begin: heave, pitch, wheels, rider, then their speeds, then the currents."""

STATE = 12


@njit(cache=True)
def element_force(strut: Strut, u: float) -> float:
    """Static force of a fork leg or shock compressed by `u` metres, in newtons, extending positive."""
    force = strut.preload_n + strut.spring_n_per_m * u
    if strut.air_n > 0.0:
        # polytropic air column: p A ((L / (L - u))^n - 1)
        if strut.air_exponent == 1.0:
            force += strut.air_n * u / (strut.air_length_m - u)
        else:
            force += strut.air_n * (
                (strut.air_length_m / (strut.air_length_m - u)) ** strut.air_exponent - 1.0
            )
    if u > strut.bump_m:
        force += strut.bump_n_per_m2 * (u - strut.bump_m) ** 2
    if u < strut.topout_m:
        force -= strut.topout_n_per_m2 * (strut.topout_m - u) ** 2
    return force


@njit(cache=True)
def yield_force(strut: Strut, current: float) -> float:
    """Force in newtons at which a magnetorheological damper begins to move under `current` amperes.

    Rises with the current and saturates with the magnetic circuit: F(I) ~ I / (I + I_half); 2 A give all.
    """
    return strut.mr_full_n * current * (MOST_A + strut.mr_half_a) / (MOST_A * (current + strut.mr_half_a))


@njit(cache=True)
def current_for(strut: Strut, force: float) -> float:
    """Current in amperes, 0.1 to 2, whose yield force is nearest to `force`: `yield_force` turned round."""
    share = force * MOST_A / (strut.mr_full_n * (MOST_A + strut.mr_half_a))
    if share >= 1.0:
        return MOST_A
    return min(max(share * strut.mr_half_a / (1.0 - share), LEAST_A), MOST_A)


@njit(cache=True)
def sky_hook(strut: Strut, w: float, w_dot: float, body_dot: float, sky_ns_per_m: float) -> float:
    """Current in amperes with which the damper comes nearest to hanging the body's end on the sky.

    w, w_dot: wheel travel and its speed; body_dot: the body's own vertical speed there, up. The damper can
    only oppose its own motion: where it would push the body the way it goes, it gets the least current.
    """
    if body_dot * w_dot >= 0.0 or sky_ns_per_m <= 0.0:
        return LEAST_A
    ratio = strut.linkage + strut.linkage_rise_per_m * w
    u_dot = abs(ratio * w_dot)
    c = strut.compression_fast_ns_per_m if w_dot > 0.0 else strut.rebound_fast_ns_per_m
    wanted = sky_ns_per_m * abs(body_dot) / ratio - c * u_dot
    # what the yield force has reached at this speed: v / (v + v_knee)
    return current_for(strut, wanted * (1.0 + strut.mr_knee_m_per_s / (u_dot + 1e-4)))


@njit(cache=True)
def wheel_force(strut: Strut, w: float, w_dot: float, current: float = 0.0, damper: float = 1.0) -> float:
    """Vertical force at the wheel of a strut, in newtons, for wheel travel `w` (m) and its speed (m/s).

    current: in the coil of a magnetorheological damper, A. damper: factor on the oil's damping.
    """
    ratio = strut.linkage + strut.linkage_rise_per_m * w
    u = (strut.linkage + 0.5 * strut.linkage_rise_per_m * w) * w
    u_dot = ratio * w_dot
    speed = abs(u_dot)
    if u_dot > 0.0:
        slow, fast = strut.compression_ns_per_m, strut.compression_fast_ns_per_m
    else:
        slow, fast = strut.rebound_ns_per_m, strut.rebound_fast_ns_per_m
    # digressive damper: c(v) = c_fast + (c_slow - c_fast) / (1 + |v| / v_knee)
    damping = damper * (fast + (slow - fast) * strut.knee_m_per_s / (strut.knee_m_per_s + speed))
    # FIDELITY: seals slide from the first micrometre, they never stick
    damping += strut.friction_n / (strut.friction_m_per_s + speed)
    if strut.mr_full_n > 0.0:
        damping += yield_force(strut, current) / (strut.mr_knee_m_per_s + speed)
    # virtual work: F_wheel dw = F_element du
    return ratio * (element_force(strut, u) + damping * u_dot)


@njit(cache=True)
def tyre_force(tyre: Tyre, deflection: float, deflection_speed: float) -> float:
    """Force of the road on the wheel, in newtons: k d (1 + lambda d'), zero in the air, never negative.

    FIDELITY: one point of contact, stiffness constant over speed and load.
    """
    if deflection <= 0.0:
        return 0.0
    return max(0.0, tyre.stiffness_n_per_m * deflection * (1.0 + tyre.damping_s_per_m * deflection_speed))


@njit(cache=True)
def accelerate(m: Motorcycle, y: Any, ground: Any, now: Any, dy: Any) -> None:
    """Write the time derivative of the state `y` to `dy`.

    y: heave, pitch, front wheel, rear wheel, rider (m, rad), then their speeds, then the currents front and
    rear (A). ground: road height under front and rear wheel (m), then its rate of change (m/s). now: as WAY;
    push_n is the force of the road along the road, driving positive, moment_nm what pitches the body nose up,
    weight and damper are factors on gravity and on the dampers' oil. dy gets, after the derivatives, both
    tyre forces.
    """
    gravity, damper = GRAVITY_M_PER_S2 * now[4], now[5]
    front_travel = y[2] - (y[0] - m.to_front_m * y[1])
    rear_travel = y[3] - (y[0] + m.to_rear_m * y[1])
    nose_speed = y[5] - m.to_front_m * y[6]
    tail_speed = y[5] + m.to_rear_m * y[6]
    front_speed = y[7] - nose_speed
    rear_speed = y[8] - tail_speed
    front = wheel_force(m.fork, front_travel, front_speed, y[10], damper)
    rear = wheel_force(m.shock, rear_travel, rear_speed, y[11], damper)
    # The part of the longitudinal forces that links and legs carry past the springs.
    # FIDELITY: constant ratios; chain and swingarm angles change with travel on a real motorcycle.
    if now[2] < 0.0:
        front += m.dive_ratio * m.front_brake_share * now[2]
        rear += m.squat_ratio * (1.0 - m.front_brake_share) * now[2]
    else:
        rear += m.squat_ratio * now[2]
    front_load = tyre_force(m.front_tyre, ground[0] - y[2], ground[2] - y[7])
    rear_load = tyre_force(m.rear_tyre, ground[1] - y[3], ground[3] - y[8])
    # The rider's upper body on its spring; its weight is in the spring's rest length.
    omega = TURN * m.rider_hz
    seat = y[0] + m.rider_behind_m * y[1] - y[4]
    seat_speed = y[5] + m.rider_behind_m * y[6] - y[9]
    rider = m.rider_kg * (omega * omega * seat + 2.0 * m.rider_damping * omega * seat_speed + gravity)
    for i in range(5):  # a slice assignment would cost a second of compilation
        dy[i] = y[i + 5]
    dy[5] = (front + rear - rider) / m.sprung_kg - gravity
    dy[6] = (
        m.to_rear_m * rear - m.to_front_m * front - m.rider_behind_m * rider - now[3]
    ) / m.pitch_inertia_kgm2
    dy[7] = (front_load - front) / m.front_kg - gravity
    dy[8] = (rear_load - rear) / m.rear_kg - gravity
    dy[9] = rider / m.rider_kg - gravity
    if m.fork.mr_full_n > 0.0:
        wanted = sky_hook(m.fork, front_travel, front_speed, nose_speed, m.magneto.sky_front_ns_per_m)
        dy[10] = (wanted - y[10]) / m.magneto.lag_s
    if m.shock.mr_full_n > 0.0:
        wanted = sky_hook(m.shock, rear_travel, rear_speed, tail_speed, m.magneto.sky_rear_ns_per_m)
        dy[11] = (wanted - y[11]) / m.magneto.lag_s
    dy[12] = front_load
    dy[13] = rear_load


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
    row[2] = y[6] * DEGREES_PER_RADIAN
    row[3] = dy[7]
    row[4] = dy[8]
    row[5] = dy[5] - m.body_sensor_m * dy[6]
    row[6] = dy[12]
    row[7] = dy[13]
    row[8] = y[10]
    row[9] = y[11]


@njit(cache=True)
def integrate(m: Motorcycle, y: Any, height: Any, per_m: float, way: Any, substeps: int, out: Any) -> None:
    """Classical Runge-Kutta; `way` holds the rows of WAY (6, samples), linear in between."""
    wheelbase = m.to_front_m + m.to_rear_m
    h = 0.001 / substeps
    # rows: the slopes of the four stages; columns: derivatives and tyre forces
    slope = np.zeros((4, STATE + 2))
    ground = np.empty(4)
    stage = np.empty(STATE)
    now = np.empty(6)
    for k in range(way.shape[1]):
        after = min(k + 1, way.shape[1] - 1)
        for part in range(substeps):
            for q in range(4):
                # stages at 0, h/2, h/2, h
                ahead = 0.0 if q == 0 else (1.0 if q == 3 else 0.5)
                f = (part + ahead) / substeps
                for i in range(6):
                    now[i] = way[i, k] + f * (way[i, after] - way[i, k])
                _look(height, per_m, now[0] + wheelbase, now[1], ground, 0)
                _look(height, per_m, now[0], now[1], ground, 1)
                for i in range(STATE):
                    stage[i] = y[i] + ahead * h * slope[q - 1, i]
                accelerate(m, stage, ground, now, slope[q])
                if q == 0 and part == 0:
                    _write(m, y, slope[0], out[k])
            for i in range(STATE):
                y[i] += h / 6.0 * (slope[0, i] + 2.0 * (slope[1, i] + slope[2, i]) + slope[3, i])


def equilibrium(
    motorcycle: Motorcycle, push_n: float = 0.0, moment_nm: float = 0.0, weight: float = 1.0
) -> NDArray[np.float64]:
    """State (12,) at rest or in steady running on a flat road at height zero; arguments as WAY."""
    m = motorcycle
    g = GRAVITY_M_PER_S2 * weight
    # moments about the rear contact: body, rider, and what pitches nose up
    front_load = (
        g * (m.sprung_kg * m.to_rear_m + m.rider_kg * (m.to_rear_m - m.rider_behind_m)) - moment_nm
    ) / m.wheelbase_m
    rear_load = g * (m.sprung_kg + m.rider_kg) - front_load
    back = min(push_n, 0.0)
    front = _sag(m.fork, front_load - m.dive_ratio * m.front_brake_share * back)
    rear = _sag(m.shock, rear_load - m.squat_ratio * (max(push_n, 0.0) + (1.0 - m.front_brake_share) * back))
    front_wheel = -(front_load + m.front_kg * g) / m.front_tyre.stiffness_n_per_m
    rear_wheel = -(rear_load + m.rear_kg * g) / m.rear_tyre.stiffness_n_per_m
    nose, tail = front_wheel - front, rear_wheel - rear
    pitch = (tail - nose) / m.wheelbase_m
    heave = nose + m.to_front_m * pitch
    state = np.zeros(STATE)
    state[:SPEED] = heave, pitch, front_wheel, rear_wheel, heave + m.rider_behind_m * pitch
    state[10:] = LEAST_A
    return state


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
    way: NDArray[np.float64],
    substeps: int = SUBSTEPS,
) -> NDArray[np.float64]:
    """Drive the motorcycle over a road, from the equilibrium of the first sample.

    height_m: road every `step_m`, from where the rear wheel starts (there it must be zero) to beyond the
    front wheel's end. way: (6, samples) at 1 kHz, rows as in WAY: rear wheel's place on the road, speed,
    longitudinal road force, moment pitching the body nose up, factors on gravity and on the dampers' oil.
    Returns (samples, 10), columns as in COLUMNS.
    """
    out = np.empty((way.shape[1], len(COLUMNS)))
    state = equilibrium(motorcycle, way[2, 0], way[3, 0], way[4, 0])
    integrate(motorcycle, state, height_m, 1.0 / step_m, way, substeps, out)
    return out

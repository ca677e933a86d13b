"""The planar robot's equations of motion, compiled.

With v the speed, w the turn rate, b half the track, and v_i = v -+ w b the speed over ground of the
left and the right wheel:

    m v' = F_l + F_r - drag |v| v          I w' = b (F_r - F_l)
    F_i  = torque_i / r_i - (damping / 2) (r / r_i)^2 v_i - (friction / 2) (r / r_i) s(v_i)
    s(v) = v / sqrt(v^2 + e^2)             e = 1 cm/s

A step solves the velocities by the trapezoid rule with resistances at the extrapolated midpoint
(linearly implicit, second order, stable for any resistance). Steps end where
a delayed command changes, so that the response follows the latency exactly; the first step after
such a change, where the midpoint cannot be extrapolated, is computed twice.
"""

from __future__ import annotations

import math

import numpy as np

from s2rtools.common.numba_cache import njit
from s2rtools.sysid.simulators.simulator import Floats, Integers

_CREEP = 0.01
"""e, m/s"""
_SHORTEST = 1e-9
"""Shortest step, s."""


@njit(cache=True)
def replay_all(
    body: Floats, step: float, times: Floats, first: Integers, drive: Integers,
    command_time: Floats, torque: Floats, held: Integers, states: Floats, out: Floats,
) -> None:  # fmt: skip
    """Fill `out` (n, 5) with the states at `times`; the other arguments are those of `Replays`.

    `body`: mass, inertia, half track, left, right and nominal radius, friction, damping, drag,
    latency; `torque` (2, k) in N m.
    """
    latency = body[9]
    now = np.zeros(7)
    for number in range(len(first) - 1):
        a, b = first[number], first[number + 1]
        if b <= a:
            continue
        low, high = held[drive[number]], held[drive[number] + 1]
        now[:5] = states[number]
        now[5:] = 0.0
        out[a] = states[number]
        t, last = times[a], times[b - 1]
        j = a + 1
        k = low - 1 + np.searchsorted(command_time[low:high], t - latency, side="right")
        while j < b:
            end = last
            if k + 1 < high and command_time[k + 1] + latency < last:
                end = command_time[k + 1] + latency
            left, right = 0.0, 0.0
            if k >= low:
                left, right = torque[0, k] / body[3], torque[1, k] / body[4]
            k += 1
            if end - t < _SHORTEST:
                if end < last:
                    continue
                end, t = last, last - _SHORTEST
            j = _integrate(body, step, t, end, left, right, now, times[:b], j, out)
            t = end


@njit(cache=True)
def _integrate(
    body: Floats, step: float, t: float, end: float, left: float, right: float,
    now: Floats, times: Floats, j: int, out: Floats,
) -> int:  # fmt: skip
    """Integrate from t to `end` under constant forces; fill `out` from row j, return the next row.

    `now` (7,) holds x, y, heading, v, w and the accelerations v' and w' of the last step, and is
    updated. If `end` is the last of `times`, all remaining rows are filled. Between steps,
    velocities are linear and positions cubic (Hermite).
    """
    x, y, heading, v, w, dv, dw = now[0], now[1], now[2], now[3], now[4], now[5], now[6]
    b = len(times)
    count = max(1, math.ceil((end - t) / step - 1e-6))
    h = (end - t) / count
    for number in range(count):
        v1, w1 = _speeds(body, h, v, w, v + 0.5 * h * dv, w + 0.5 * h * dw, left, right)
        if number == 0:
            v1, w1 = _speeds(body, h, v, w, 0.5 * (v + v1), 0.5 * (w + w1), left, right)
        dv, dw = (v1 - v) / h, (w1 - w) / h
        middle = heading + h * (0.375 * w + 0.125 * w1)
        x1 = x + 0.5 * h * (v + v1) * math.cos(middle)
        y1 = y + 0.5 * h * (v + v1) * math.sin(middle)
        heading1 = heading + 0.5 * h * (w + w1)
        t1 = t + (number + 1) * h
        while j < b and (times[j] <= t1 or (number == count - 1 and end == times[b - 1])):
            s = min((times[j] - (t1 - h)) / h, 1.0)
            s2, s3 = s * s, s * s * s
            p, q, r = 3.0 * s2 - 2.0 * s3, h * (s3 - 2.0 * s2 + s), h * (s3 - s2)
            out[j, 0] = x + p * (x1 - x) + q * v * math.cos(heading) + r * v1 * math.cos(heading1)
            out[j, 1] = y + p * (y1 - y) + q * v * math.sin(heading) + r * v1 * math.sin(heading1)
            out[j, 2] = heading + h * s * (w + 0.5 * s * (w1 - w))
            out[j, 3] = v + s * (v1 - v)
            out[j, 4] = w + s * (w1 - w)
            j += 1
        x, y, heading, v, w = x1, y1, heading1, v1, w1
    now[:] = (x, y, heading, v, w, dv, dw)
    return j


@njit(cache=True)
def _speeds(
    body: Floats, h: float, v: float, w: float, middle_v: float, middle_w: float,
    left: float, right: float,
) -> tuple[float, float]:  # fmt: skip
    """v and w after a step under wheel forces, with the resistance at the midpoint's speeds."""
    mass, inertia, half = body[0], body[1], body[2]
    left_share, right_share = body[5] / body[3], body[5] / body[4]
    vl, vr = middle_v - middle_w * half, middle_v + middle_w * half
    friction, damping = 0.5 * body[6], 0.5 * body[7]
    dl = left_share * (damping * left_share + friction / math.sqrt(vl * vl + _CREEP * _CREEP))
    dr = right_share * (damping * right_share + friction / math.sqrt(vr * vr + _CREEP * _CREEP))
    a00 = 0.5 * h * (dl + dr + body[8] * abs(middle_v)) / mass
    a01 = 0.5 * h * (dr - dl) * half / mass
    a10 = 0.5 * h * (dr - dl) * half / inertia
    a11 = 0.5 * h * (dl + dr) * half * half / inertia
    p = (1.0 - a00) * v - a01 * w + h * (left + right) / mass
    q = (1.0 - a11) * w - a10 * v + h * (right - left) * half / inertia
    scale = 1.0 / ((1.0 + a00) * (1.0 + a11) - a01 * a10)
    return ((1.0 + a11) * p - a01 * q) * scale, ((1.0 + a00) * q - a10 * p) * scale

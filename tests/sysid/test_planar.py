"""The planar robot simulator satisfies its equations."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from s2rtools.motion_logs import Commands
from s2rtools.sysid.simulators import Planar
from s2rtools.sysid.simulators.simulator import pack

TIMES = 0.02 * np.arange(300)
SIMULATOR = Planar()
speeds = st.floats(-2.0, 2.0)
shares = st.floats(0.0, 1.0)


def torque_commands(left: np.ndarray, right: np.ndarray) -> Commands:
    time = 0.05 * np.arange(len(left))
    return Commands(time, {"left_torque": left, "right_torque": right}, 0.05, "", "")


def random_commands(seed: int, count: int = 130) -> Commands:
    rng = np.random.default_rng(seed)
    left, right = np.repeat(rng.uniform(-0.3, 0.6, (2, count // 10)), 10, axis=1)
    return torque_commands(left, right)


def parameter_values(choice: list[float]) -> dict[str, float]:
    """Parameter values at these shares of their ranges."""
    searched = [
        parameter for parameter in SIMULATOR.parameters if parameter.name not in ("latency", "gain")
    ]
    return {each.name: each.at_share(share) for each, share in zip(searched, choice, strict=True)}


@given(st.lists(shares, min_size=8, max_size=8), speeds, st.floats(-6.0, 6.0))
def test_energy_decays_without_torque(choice, speed, turn):
    values = parameter_values(choice)
    no_commands = torque_commands(np.zeros(2), np.zeros(2))
    states = SIMULATOR.simulate(values, no_commands, np.array([0, 0, 0.3, speed, turn]), TIMES)
    inertia = values["gyration"] * (values["track"] / 2) ** 2
    energy = states[:, 3] ** 2 + inertia * states[:, 4] ** 2
    assert np.isfinite(states).all()
    assert (np.diff(energy) <= 1e-12 + 1e-9 * energy[:-1]).all()


def test_swapping_the_wheels_mirrors_the_path():
    commands = random_commands(2)
    left, right = commands.channels.values()
    first = SIMULATOR.simulate({"wheels": 0.05}, torque_commands(left, right), np.zeros(5), TIMES)
    second = SIMULATOR.simulate({"wheels": -0.05}, torque_commands(right, left), np.zeros(5), TIMES)
    np.testing.assert_allclose(first, second * [1, -1, -1, 1, -1], atol=1e-10)


@given(st.floats(0.0, 0.12), st.floats(0.0, 0.12), st.integers(0, 50))
def test_latency_shifts_the_response_by_exactly_that_time(first, second, seed):
    commands = random_commands(seed)
    first_states = SIMULATOR.simulate({"latency": first}, commands, np.zeros(5), TIMES)
    shifted = TIMES + (second - first)
    start = np.concatenate([[min(0.0, shifted[0])], shifted])
    second_states = SIMULATOR.simulate({"latency": second}, commands, np.zeros(5), start)[1:]
    np.testing.assert_allclose(first_states, second_states, atol=1e-9)


def test_halving_the_step_reduces_the_error():
    commands = random_commands(3)
    exact = Planar(0.0002).simulate({}, commands, np.zeros(5), TIMES)
    errors = [
        np.abs(Planar(step).simulate({}, commands, np.zeros(5), TIMES) - exact)[:, 3:].max()
        for step in (0.02, 0.01, 0.005)
    ]
    assert errors[0] / errors[1] > 2.5
    assert errors[1] / errors[2] > 2.5
    assert errors[2] < 2e-3


def test_constant_torque_without_friction_approaches_the_terminal_speed():
    values = {"friction": 0.05, "drag": 0.0, "damping": 20.0, "mass": 5.0}
    constant_torque = np.full(200, 0.5)
    speed = SIMULATOR.simulate(
        values, torque_commands(constant_torque, constant_torque), np.zeros(5), TIMES
    )[:, 3]
    force, rate = 2 * 0.5 / 0.05 - 0.05, 20.0 / 5.0
    expected = force / 20.0 * (1 - np.exp(-rate * np.maximum(TIMES - 0.02, 0)))
    np.testing.assert_allclose(speed, expected, atol=4e-3)


def test_batched_replays_equal_separate_simulations():
    commands_of_drives = [random_commands(4), random_commands(5, 80)]
    segments = [(1, TIMES[40:90]), (0, TIMES[7:50]), (0, TIMES[100:103])]
    starts = np.random.default_rng(0).normal(0, 0.5, (3, 5))
    values = {**SIMULATOR.defaults(), "latency": 0.033}
    batch = SIMULATOR.replay(values, pack(commands_of_drives, segments, SIMULATOR.torques), starts)
    separate = [
        SIMULATOR.simulate(values, commands_of_drives[drive], start, times)
        for (drive, times), start in zip(segments, starts, strict=True)
    ]
    np.testing.assert_array_equal(batch, np.concatenate(separate))

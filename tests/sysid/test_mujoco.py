"""The MuJoCo simulator compared with the planar robot."""

import sys

import numpy as np
import pytest

from s2rstore.errors import RequestError
from s2rtools.motion_logs import Commands
from s2rtools.sysid.simulators import SIMULATORS, Planar

pytest.importorskip("mujoco")

TIMES = 0.02 * np.arange(200)


def commands(seed: int = 0) -> Commands:
    rng = np.random.default_rng(seed)
    forward = np.repeat(rng.uniform(0.0, 0.5, 8), 10)
    turn = np.repeat(rng.uniform(-0.06, 0.06, 8), 10)
    channels = {"left_torque": forward - turn, "right_torque": forward + turn}
    return Commands(0.05 * np.arange(80), channels, 0.05, "", "")


def test_the_path_equals_the_planar_robot_except_for_tyre_slip():
    start = np.array([1.0, -0.5, 2.0, 0.3, 0.2])
    mujoco = SIMULATORS["mujoco"]().simulate({}, commands(), start, TIMES)
    planar = Planar().simulate({"drag": 0.0}, commands(), start, TIMES)
    assert np.hypot(*(mujoco - planar)[:, :2].T).max() < 0.05
    assert np.abs((mujoco - planar)[:, 2]).max() < 0.08
    assert np.hypot(*(planar - start)[:, :2].T).max() > 1.0


@pytest.mark.parametrize("name", ["mass", "friction", "damping", "gain"])
def test_each_parameter_has_the_effect_of_the_planar_robot(name):
    distance_changes = {}
    for simulator in (SIMULATORS["mujoco"](), Planar()):
        base = {"drag": 0.0} if simulator.name == "planar" else {}
        changed = {**base, name: 1.4 * simulator.defaults()[name]}
        paths = [simulator.simulate(v, commands(), np.zeros(5), TIMES) for v in (base, changed)]
        distance_changes[simulator.name] = np.hypot(*paths[1][-1, :2]) - np.hypot(*paths[0][-1, :2])
    assert distance_changes["mujoco"] == pytest.approx(distance_changes["planar"], rel=0.1)


def test_gyration_has_the_effect_of_the_planar_robot():
    half = np.full(20, 0.4)
    turning = Commands(0.05 * np.arange(20), {"left_torque": -half, "right_torque": half}, 0.05,
                       "", "")  # fmt: skip
    for gyration in (0.5, 2.0):
        mujoco, planar = (
            simulator.simulate({"gyration": gyration}, turning, np.zeros(5), TIMES[:25])[-1, 2]
            for simulator in (SIMULATORS["mujoco"](), Planar())
        )
        assert mujoco == pytest.approx(planar, rel=0.05)


def test_latency_is_resolved_below_the_time_step():
    simulator = SIMULATORS["mujoco"]()
    push = {"left_torque": np.full(2, 0.4), "right_torque": np.full(2, 0.4)}
    commands_pushed = Commands(np.array([0.0, 5.0]), push, 0.05, "", "")
    final_positions = [
        simulator.simulate(
            {"latency": latency, "friction": 0.05}, commands_pushed, np.zeros(5), TIMES
        )[50, 0]
        for latency in (0.020, 0.021, 0.022, 0.025)
    ]
    steps = -np.diff(final_positions)
    assert steps[0] == pytest.approx(steps[1], rel=0.2)
    assert steps[0] == pytest.approx(steps[2] / 3, rel=0.2)


def test_a_missing_mujoco_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(RequestError, match=r"s2rtui\[mujoco\]"):
        SIMULATORS["mujoco"]()

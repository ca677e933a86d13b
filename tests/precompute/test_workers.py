"""Worker processes: their number, the order of their units, and the code compiled for them."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from s2rtools.common import processors
from s2rtools.common.processors import available_memory
from s2rtools.precompute.executors import local_executors
from s2rtools.precompute.executors.executor import largest_first


@pytest.mark.parametrize(
    ("processors", "memory", "instances", "workers"),
    [
        (8, 64 * 2**30, 100, 1), (8, 64 * 2**30, 1084, 4), (2, 64 * 2**30, 10**6, 2),
        (8, 5 * 2**30, 10**6, 2), (8, 2**30, 10**6, 1), (8, None, 10**6, 8),
    ],
)  # fmt: skip
def test_workers_are_limited_by_processors_memory_and_work(
    monkeypatch, processors, memory, instances, workers
):
    monkeypatch.setattr(local_executors, "available_processors", lambda: processors)
    monkeypatch.setattr(local_executors, "available_memory", lambda: memory)
    assert local_executors.default_workers(instances) == workers


def test_units_that_take_the_longest_come_first():
    def unit(name: str, number: int, instances: int) -> SimpleNamespace:
        stage = SimpleNamespace(name=name)
        return SimpleNamespace(stage=stage, number=number, instances=range(instances))

    units = [
        unit("forward", 0, 256), unit("forward", 1, 30),
        unit("occlusion", 0, 64), unit("occlusion", 1, 64), unit("occlusion", 2, 9),
    ]  # fmt: skip
    ordered = [(each.stage.name, each.number) for each in largest_first(units)]
    assert ordered == [
        ("occlusion", 0), ("occlusion", 1), ("occlusion", 2), ("forward", 0), ("forward", 1),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("group", "files"),
    [
        ("0::/job/step", ("memory.max", "memory.current", "inactive_file")),
        ("4:memory:/job/step",
         ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")),
    ],
)  # fmt: skip
def test_cached_files_do_not_count_as_used_memory(monkeypatch, group, files):
    """A job that has read 7 of its 8 GB as files can still allocate these."""
    root = "/sys/fs/cgroup" if group.startswith("0") else "/sys/fs/cgroup/memory"
    limit, used, cached = files
    contents = {
        "/proc/meminfo": "MemAvailable: 16777216 kB\n",
        "/proc/self/cgroup": f"9:name=systemd:/\n{group}\n",
        f"{root}/job/{limit}": f"{8 << 30}\n",
        f"{root}/job/{used}": f"{15 << 29}\n",
        f"{root}/job/memory.stat": f"anon 5\n{cached} {7 << 30}\n",
        f"{root}/job/step/{limit}": "max\n",
    }
    monkeypatch.setattr(processors, "_read", lambda path: contents.get(Path(path).as_posix(), ""))
    assert available_memory() == 15 << 29

"""Processors and memory of a container are those of its control groups, of both versions, and not the computer's."""

from pathlib import Path

import psutil
import pytest

from pipeline.execution import machine


def tree(root: Path, files: dict[str, str]) -> Path:
    for name, content in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    return root


@pytest.fixture
def large(monkeypatch):
    """Run on a computer with 64 processors and 256 GB."""
    monkeypatch.setattr("os.sched_getaffinity", lambda _: set(range(64)), raising=False)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: type("", (), {"available": 256_000_000_000}))


def test_version_2_takes_the_tightest_limit_of_all_levels(large, tmp_path):
    files = {
        "proc/self/cgroup": "0::/slice/job\n",
        "sys/fs/cgroup/slice/cpu.max": "350000 100000\n",
        "sys/fs/cgroup/slice/memory.max": "max\n",
        "sys/fs/cgroup/slice/memory.current": "7000000000\n",
        "sys/fs/cgroup/slice/job/cpu.max": "max 100000\n",
        "sys/fs/cgroup/slice/job/memory.max": "8000000000\n",
        "sys/fs/cgroup/slice/job/memory.current": "7000000000\n",
        "sys/fs/cgroup/slice/job/memory.stat": "anon 1000000000\ninactive_file 5500000000\n",
    }
    assert machine.processors(tree(tmp_path, files)) == 3
    assert machine.available_memory(tmp_path) == 6_500_000_000


def test_version_1_inside_a_container_whose_path_is_the_hosts(large, tmp_path):
    files = {
        "proc/self/cgroup": "4:memory:/docker/5f0c\n2:cpu,cpuacct:/docker/5f0c\n",
        "sys/fs/cgroup/cpu/cpu.cfs_quota_us": "200000\n",
        "sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000\n",
        "sys/fs/cgroup/memory/memory.limit_in_bytes": "4000000000\n",
        "sys/fs/cgroup/memory/memory.usage_in_bytes": "1000000000\n",
        "sys/fs/cgroup/memory/memory.stat": "total_inactive_file 200000000\n",
    }
    assert machine.processors(tree(tmp_path, files)) == 2
    assert machine.available_memory(tmp_path) == 3_200_000_000


def test_no_limit_and_less_than_one_processor(large, tmp_path):
    files = {
        "proc/self/cgroup": "4:memory:/\n2:cpu,cpuacct:/\n",
        "sys/fs/cgroup/cpu/cpu.cfs_quota_us": "-1\n",
        "sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000\n",
        "sys/fs/cgroup/memory/memory.limit_in_bytes": "9223372036854771712\n",
        "sys/fs/cgroup/memory/memory.usage_in_bytes": "1000000000\n",
    }
    assert machine.processors(tree(tmp_path, files)) == 64
    assert machine.available_memory(tmp_path) == 256_000_000_000
    tree(tmp_path, {"sys/fs/cgroup/cpu/cpu.cfs_quota_us": "50000\n"})
    assert machine.processors(tmp_path) == 1

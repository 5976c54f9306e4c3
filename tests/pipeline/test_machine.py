"""Processors and memory of a container are those of its control groups, of both versions, and not the computer's."""

import psutil
import pytest

from pipeline.execution import machine

V1 = "sys/fs/cgroup/memory/memory."
#: Files of control groups, and the processors and bytes that they leave.
GROUPS = {
    "version 2 takes the tightest limit of all levels": (
        {
            "proc/self/cgroup": "0::/slice/job",
            "sys/fs/cgroup/slice/cpu.max": "350000 100000",
            "sys/fs/cgroup/slice/memory.max": "max",
            "sys/fs/cgroup/slice/memory.current": "7000000000",
            "sys/fs/cgroup/slice/job/cpu.max": "max 100000",
            "sys/fs/cgroup/slice/job/memory.max": "8000000000",
            "sys/fs/cgroup/slice/job/memory.current": "7000000000",
            "sys/fs/cgroup/slice/job/memory.stat": "anon 1000000000\ninactive_file 5500000000",
        },
        (3, 6_500_000_000),
    ),
    "version 1 inside a container whose path is the host's": (
        {
            "proc/self/cgroup": "4:memory:/docker/5f0c\n2:cpu,cpuacct:/docker/5f0c",
            "sys/fs/cgroup/cpu/cpu.cfs_quota_us": "200000",
            "sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000",
            f"{V1}limit_in_bytes": "4000000000",
            f"{V1}usage_in_bytes": "1000000000",
            f"{V1}stat": "total_inactive_file 200000000",
        },
        (2, 3_200_000_000),
    ),
    "no limit": (
        {
            "proc/self/cgroup": "4:memory:/\n2:cpu,cpuacct:/",
            "sys/fs/cgroup/cpu/cpu.cfs_quota_us": "-1",
            "sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000",
            f"{V1}limit_in_bytes": "9223372036854771712",
            f"{V1}usage_in_bytes": "1000000000",
        },
        (64, 256_000_000_000),
    ),
    "less than one processor": (
        {
            "proc/self/cgroup": "2:cpu,cpuacct:/",
            "sys/fs/cgroup/cpu/cpu.cfs_quota_us": "50000",
            "sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000",
        },
        (1, 256_000_000_000),
    ),
}


@pytest.mark.parametrize("case", GROUPS)
def test_limits_of_control_groups_count(case, monkeypatch, tmp_path):
    """Of a computer with 64 processors and 256 GB."""
    monkeypatch.setattr("os.sched_getaffinity", lambda _: set(range(64)), raising=False)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: type("", (), {"available": 256_000_000_000}))
    files, left = GROUPS[case]
    for name, content in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{content}\n")
    assert (machine.processors(tmp_path), machine.available_memory(tmp_path)) == left

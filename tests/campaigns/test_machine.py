"""Free memory from the kernel's files and from control groups of both versions; the lowest limit applies."""

from pathlib import Path

import pytest

from anser.campaigns.machine import available_memory
from anser.compiling.measuring import usable_cores

GB = 10**9
UNLIMITED = 9223372036854771712  # as version 1 writes that there is no limit


@pytest.fixture
def machine(tmp_path):
    """Simulated kernel files: 8 GB available, and the control groups of the process."""

    def write_files(groups, **files):
        (tmp_path / "proc/self").mkdir(parents=True)
        (tmp_path / "proc/meminfo").write_text(f"MemTotal: 16000000 kB\nMemAvailable:  {8 * GB // 1024} kB\n")
        (tmp_path / "proc/self/cgroup").write_text(groups)
        for name, text in files.items():
            path = tmp_path / "sys/fs/cgroup" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"{text}\n")
        return tmp_path

    return write_files


def test_the_memory_without_groups_is_that_of_the_kernel(machine):
    assert available_memory(machine("0::/\n")) == 8 * GB // 1024 * 1024


def test_a_limit_of_version_2_applies_without_cached_files(machine):
    stat = f"anon {GB}\ninactive_file {GB}"
    root = machine(
        "0::/jobs/one\n",
        **{"jobs/one/memory.max": 5 * GB, "jobs/one/memory.current": 3 * GB, "jobs/one/memory.stat": stat},
    )
    assert available_memory(root) == 3 * GB


def test_a_limit_of_a_parent_group_applies(machine):
    root = machine(
        "0::/jobs/one\n",
        **{"jobs/one/memory.max": "max", "jobs/one/memory.current": GB},
        **{"jobs/memory.max": 2 * GB, "jobs/memory.current": GB},
    )
    assert available_memory(root) == GB


def test_a_limit_of_version_1_applies(machine):
    groups = "9:name=systemd:/\n4:cpu,memory:/jobs/one\n0::/\n"
    root = machine(
        groups,
        **{"memory/jobs/one/memory.limit_in_bytes": 4 * GB, "memory/jobs/one/memory.usage_in_bytes": 2 * GB},
        **{"memory/jobs/one/memory.stat": f"total_inactive_file {GB}"},
        **{"memory/memory.limit_in_bytes": UNLIMITED, "memory/memory.usage_in_bytes": 9 * GB},
    )
    assert available_memory(root) == 3 * GB


def test_the_group_of_a_container_is_at_the_top(machine):
    root = machine("0::/../elsewhere\n", **{"memory.max": 3 * GB, "memory.current": 4 * GB})
    assert available_memory(root) == 0


def test_this_machine_has_memory_and_a_core():
    free_bytes = available_memory()
    assert free_bytes is not None
    assert free_bytes > 10**8
    assert usable_cores() >= 1


def test_the_memory_of_a_silent_system_is_unknown(tmp_path, monkeypatch):
    monkeypatch.setattr("anser.campaigns.machine.os.sysconf", lambda name: (_ for _ in ()).throw(ValueError))
    assert available_memory(Path(tmp_path)) is None

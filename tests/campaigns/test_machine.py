"""Memory that is free is read from the kernel's files and from control groups of both versions, the least counts."""

from pathlib import Path

import pytest

from anser.campaigns.machine import available_memory, usable_cores

GB = 10**9
UNLIMITED = 9223372036854771712  # as version 1 writes that there is no limit


@pytest.fixture
def machine(tmp_path):
    """Files of a kernel: of 8 GB available, and in what groups the process is."""

    def made(groups, **files):
        (tmp_path / "proc/self").mkdir(parents=True)
        (tmp_path / "proc/meminfo").write_text(f"MemTotal: 16000000 kB\nMemAvailable:  {8 * GB // 1024} kB\n")
        (tmp_path / "proc/self/cgroup").write_text(groups)
        for place, text in files.items():
            path = tmp_path / "sys/fs/cgroup" / place
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"{text}\n")
        return tmp_path

    return made


def test_without_groups_it_is_what_the_kernel_says(machine):
    assert available_memory(machine("0::/\n")) == 8 * GB // 1024 * 1024


def test_a_group_of_version_2_may_have_less_and_files_that_were_read_do_not_count(machine):
    stat = f"anon {GB}\ninactive_file {GB}"
    root = machine(
        "0::/jobs/one\n",
        **{"jobs/one/memory.max": 5 * GB, "jobs/one/memory.current": 3 * GB, "jobs/one/memory.stat": stat},
    )
    assert available_memory(root) == 3 * GB


def test_a_group_above_may_have_less_still(machine):
    root = machine(
        "0::/jobs/one\n",
        **{"jobs/one/memory.max": "max", "jobs/one/memory.current": GB},
        **{"jobs/memory.max": 2 * GB, "jobs/memory.current": GB},
    )
    assert available_memory(root) == GB


def test_a_group_of_version_1_counts_alike(machine):
    groups = "9:name=systemd:/\n4:cpu,memory:/jobs/one\n0::/\n"
    root = machine(
        groups,
        **{"memory/jobs/one/memory.limit_in_bytes": 4 * GB, "memory/jobs/one/memory.usage_in_bytes": 2 * GB},
        **{"memory/jobs/one/memory.stat": f"total_inactive_file {GB}"},
        **{"memory/memory.limit_in_bytes": UNLIMITED, "memory/memory.usage_in_bytes": 9 * GB},
    )
    assert available_memory(root) == 3 * GB


def test_a_container_sees_its_group_at_the_top(machine):
    root = machine("0::/../elsewhere\n", **{"memory.max": 3 * GB, "memory.current": 4 * GB})
    assert available_memory(root) == 0


def test_this_machine_has_some_memory_and_a_core():
    found = available_memory()
    assert found is not None
    assert found > 10**8
    assert usable_cores() >= 1


def test_nothing_is_known_of_a_machine_that_does_not_say(tmp_path, monkeypatch):
    monkeypatch.setattr("anser.campaigns.machine.os.sysconf", lambda name: (_ for _ in ()).throw(ValueError))
    assert available_memory(Path(tmp_path)) is None

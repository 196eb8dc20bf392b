"""The memory left is found correctly; memory is returned to the system without breaking anything."""

import os
import re
import resource

import pytest
from support.commands import run

from wrt.backend.memory import memory_left

MACHINE = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
RESIDENT = 1000 * os.sysconf("SC_PAGE_SIZE")


def test_limits_of_control_groups(tmp_path):
    for number, (cgroup, files, limit) in enumerate(
        (
            ("", {}, MACHINE),
            ("0::/a/b\n", {"a/b/memory.max": "50000000\n", "a/memory.max": "40000000\n"}, 40_000_000),
            ("0::/a/b\n", {"a/b/memory.max": "max\n", "other/memory.max": "1\n"}, MACHINE),
            ("0::/\n", {"memory.max": "30000000\n"}, 30_000_000),  # a container with its own cgroup namespace
            ("0::/machine/c1\n", {"memory.max": "30000000\n"}, 30_000_000),  # a container without one
            ("1:name=systemd:/x\n4:memory:/a\n", {"memory/a/memory.limit_in_bytes": "20000000\n"}, 20_000_000),
            ("4:memory:/docker/c\n", {"memory/memory.limit_in_bytes": "20000000\n"}, 20_000_000),
            ("4:memory:/a\n", {"memory/a/memory.limit_in_bytes": "9223372036854771712\n"}, MACHINE),
            ("nonsense\n0::/a\n", {"a/memory.max": "none of these\n"}, MACHINE),
            ("0::/a\n", {"a/memory.max": "1000\n"}, RESIDENT),  # less than the process has already
        )
    ):
        proc, groups = tmp_path / f"{number}" / "proc", tmp_path / f"{number}" / "groups"
        files = {groups / name: text for name, text in files.items()}
        files |= {proc / "statm": "3000 1000 10 1 0 2000 0\n", proc / "cgroup": cgroup}
        for path, text in files.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        assert memory_left(proc, groups) == limit - RESIDENT, cgroup
    assert memory_left(tmp_path / "none", tmp_path / "none") == MACHINE  # without limits


@pytest.mark.parametrize("kind", [resource.RLIMIT_AS, pytest.param(resource.RLIMIT_DATA, marks=pytest.mark.slow)])
def test_limits_of_the_process_are_known(kind, tmp_path):
    command = ("render", "cornell-box", "--size", "8000x8000", "--spp", "1", "-o", "x.png", "--quiet")
    result = run(tmp_path, *command, before=lambda: resource.setrlimit(kind, (2 << 30, 2 << 30)))
    assert result.returncode == 1, result.stderr
    message = r"wrt: error: a picture of 8000x8000 needs 7\.7 GB, more than the [0-2]\.\d GB that cpu has left\n"
    assert re.fullmatch(message, result.stderr)

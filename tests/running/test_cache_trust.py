"""Machine code is loaded only from folders to which no user but this one and root can write."""

import os
import stat
import tempfile
import warnings
from pathlib import Path

import pytest

from wrt.backend import cache_folders
from wrt.backend.artefacts import Artefacts
from wrt.backend.cache_folders import digest
from wrt.backend.kernel_cache import DIGEST


@pytest.fixture
def tmp_path():
    """A folder that others can search, unlike those above pytest's."""
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:
        os.chmod(folder, 0o755)
        yield Path(folder)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A cache in a folder of its own, with no folders used or warned of before."""
    monkeypatch.setattr(cache_folders, "_warnings_given", set())
    monkeypatch.delenv("WARP_CACHE_PATH", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_a_new_cache_is_private_and_in_a_shared_folder_each_user_has_one(cache):
    before = os.umask(0)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert cache_folders.warp_folder() == cache / "warp"
            assert cache_folders.wrt_folder() == cache / "wrt"
            cache_folders.require_writable(cache_folders.warp_folder() / "1.0")
            # It stays usable, although the compiler makes folders in it that only this one protects.
            assert cache_folders.warp_folder() == cache / "warp"
            (cache / "warp" / "1.0" / "module").mkdir()
            assert cache_folders.is_private(cache / "warp" / "1.0" / "module")
    finally:
        os.umask(before)
    assert [stat.S_IMODE(each.stat().st_mode) for each in (cache, cache / "warp")] == [0o700, 0o700]
    cache.chmod(0o755)
    (cache / "warp").chmod(0o711)
    assert not cache_folders.is_private(cache / "warp" / "1.0" / "module")
    (cache / "warp").chmod(0o700)
    cache.chmod(0o1777)
    assert cache_folders.warp_folder() == cache / f"uid-{os.getuid()}" / "warp"


@pytest.mark.parametrize("open_to_others", ["cache/warp", "cache", "."])
def test_folders_that_others_can_write_to_are_not_used(open_to_others, cache, tmp_path):
    (cache / "warp").mkdir(parents=True)
    (tmp_path / open_to_others).chmod(0o777)
    with pytest.warns(UserWarning, match="others can write to"):
        found = cache_folders.warp_folder()
    assert found == cache_folders.work_folder() / "warp"
    assert cache_folders.is_private(found)


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give folders away")
def test_folders_of_other_users_are_not_used(cache):
    (cache / "wrt").mkdir(parents=True)
    os.chown(cache / "wrt", 12345, 12345)
    with pytest.warns(UserWarning, match="belongs to another user"):
        assert cache_folders.wrt_folder() == cache_folders.work_folder() / "wrt"


def test_no_table_names_code_where_others_write(tmp_path, monkeypatch):
    shared = tmp_path / "shared"
    shared.mkdir()
    code = shared / "module.o"
    code.write_bytes(b"machine code")
    Path(f"{code}{DIGEST}").write_bytes(digest(b"machine code") + b" meta")
    artefacts = Artefacts()
    artefacts.table["files"]["module"] = {"file": str(code), "bytes": 12, "kernels": {"kernel": ["symbol", 8, []]}}
    loaded = []
    monkeypatch.setattr(artefacts, "load", lambda file, symbol: loaded.append(symbol) or symbol)
    assert artefacts.kernel("module", "kernel") == ("symbol", [8, []])
    shared.chmod(0o777)
    assert artefacts.kernel("module", "kernel") is None
    assert loaded == ["symbol"]


def test_checksums_do_not_depend_on_the_python():
    """Two interpreters that share a cache must not find each other's kernels damaged."""
    assert digest(b"kernel") == b"5dd29aab00000006"


def test_folders_whose_paths_are_not_utf8_are_not_used(cache, tmp_path, monkeypatch):
    """Compilers take paths in UTF-8."""
    odd = tmp_path / "\udcff"
    odd.mkdir()
    monkeypatch.setenv("XDG_CACHE_HOME", str(odd))
    monkeypatch.setenv("TMPDIR", str(odd))
    monkeypatch.setattr(cache_folders, "_work", None)
    with pytest.warns(UserWarning, match="its path is not UTF-8"):
        assert cache_folders.warp_folder() == cache_folders.work_folder() / "warp"
    assert odd not in cache_folders.work_folder().parents

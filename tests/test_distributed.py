"""A Dask cluster renders the bits of one machine, whatever happens to its workers."""

from __future__ import annotations

import collections
import contextlib
import gc
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_checkpoint import scene

import wrt
import wrt.distributed
from wrt.cli import main
from wrt.distributed import head, worker
from wrt.distributed.clients import client_of
from wrt.distributed.dask_cluster import DaskCluster
from wrt.distributed.processes import devices_of
from wrt.distributed.windows import windows_of_pass
from wrt.parts import render
from wrt.rendering.sharing import sharing

distributed = pytest.importorskip("distributed")
dask = pytest.importorskip("dask")

SIZE = {"width": 20, "height": 30, "max_depth": 3}
LAYERS = {"layers": ("albedo", "depth", "object", "material")}

pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),  # of Dask, at its end
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


def film_of(renderer: wrt.Renderer, *targets: int, **limits: Any) -> dict[str, Any]:
    for target in targets:
        for _ in renderer.passes(spp=target, **limits):
            pass
    return renderer.film.state()


def assert_same(a: dict[str, Any], b: dict[str, Any]) -> None:
    assert a.keys() == b.keys()
    for name, array in a.items():
        np.testing.assert_array_equal(array, b[name], err_msg=name)


@pytest.fixture(scope="module", autouse=True)
def _tidy() -> Iterator[None]:
    """Collect what Dask leaves: its tasks log when they are deleted, and in Python 3.11 no parser may run meanwhile."""
    yield
    gc.collect()


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    """Two workers in threads of this process."""
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=False, dashboard_address=":0", protocol="inproc://"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def one() -> wrt.Renderer:
    return wrt.Renderer(scene(), **SIZE, **LAYERS)


@pytest.mark.parametrize("workers", [0, 1, 3, 40, 1000])
@pytest.mark.parametrize("seconds", [0.0, 1e-9, 1e-3, 10.0])
def test_windows_cover_a_pass_once_and_shrink(workers: int, seconds: float) -> None:
    crop = (3, 5, 67, 105)
    seen = np.zeros((100, 64), int)
    heights = []
    for x0, y0, x1, y1 in windows_of_pass(crop, lambda: workers, lambda: seconds):
        seen[y0 - 5 : y1 - 5, x0 - 3 : x1 - 3] += 1
        heights.append(y1 - y0)
    assert (seen == 1).all()
    assert heights[-1] <= heights[0]
    if workers == 3 and seconds == 0.0:
        assert heights[0] == 100 // 6
        assert heights[-1] == 1


def test_the_film_is_that_of_one_machine(client: Any, one: wrt.Renderer) -> None:
    renderer = wrt.distributed.DistributedRenderer(scene(), client=client, **SIZE, **LAYERS)
    assert_same(film_of(renderer, 3, 9), film_of(one, 9))
    assert renderer.rays == one.rays
    np.testing.assert_array_equal(renderer.image(), one.image())
    assert renderer.noise() == one.noise()


@pytest.mark.parametrize("adaptive", [True, "unbiased"])
def test_render_and_a_target_of_noise(client: Any, adaptive: bool | str) -> None:
    """Samples at which it ends, and tiles that stop before, follow from the film, or from that of the pilot."""
    options = {**SIZE, "noise": 0.08, "adaptive": adaptive}
    expected = wrt.render(scene(), **options)
    np.testing.assert_array_equal(wrt.distributed.render(scene(), client=client, **options), expected)


def test_a_pilot_is_that_of_one_machine(client: Any, tmp_path: Path) -> None:
    """Also after a render that was ended on a cluster goes on there."""
    limits = {"noise": 0.08, "adaptive": "unbiased", "pass_seconds": 1e-3}
    single = wrt.Renderer(scene(), **SIZE)
    for _ in single.passes(**limits):
        pass
    renderer = wrt.distributed.DistributedRenderer(scene(), client=client, **SIZE)
    next(iter(renderer.passes(**limits)))
    renderer.save_checkpoint(tmp_path / "a.ckpt")
    again = wrt.distributed.DistributedRenderer(scene(), client=client, **SIZE)
    again.load_checkpoint(tmp_path / "a.ckpt")
    for _ in again.passes(**limits):
        pass
    assert_same(again.film.state(), single.film.state())
    assert again._pilot is not None
    assert single._pilot is not None
    assert_same(again._pilot.film.state(), single._pilot.film.state())
    assert again._pilot.film.counts.any()


def test_checkpoints_go_to_and_from_a_cluster(client: Any, one: wrt.Renderer, tmp_path: Path) -> None:
    renderer = wrt.distributed.DistributedRenderer(scene(), client=client, **SIZE, **LAYERS)
    film_of(renderer, 2)
    renderer.save_checkpoint(tmp_path / "a.ckpt")
    again = wrt.distributed.DistributedRenderer(scene(), client=client, **SIZE, **LAYERS)
    again.load_checkpoint(tmp_path / "a.ckpt")
    single = wrt.Renderer.resume(tmp_path / "a.ckpt", scene())
    assert_same(film_of(again, 5), film_of(single, 5))


def test_workers_are_counted_while_dask_renews_what_it_knows_of_them(
    client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every two seconds a client's own copy of what the scheduler knows is replaced by one without workers."""
    sync = client.sync

    def sync_and_renew(*arguments: Any, **options: Any) -> Any:
        found = sync(*arguments, **options)
        sync(client._update_scheduler_info, n_workers=0)
        return found

    monkeypatch.setattr(client, "sync", sync_and_renew)
    assert len(DaskCluster(client).addresses()) == 2


def test_a_worker_keeps_what_it_has_built_for_other_cameras(client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    built = []
    monkeypatch.setattr(worker, "_renderers", collections.OrderedDict())
    make = wrt.Renderer.__init__
    monkeypatch.setattr(wrt.Renderer, "__init__", lambda *a, **k: (built.append(k), make(*a, **k))[1])
    renderer = wrt.distributed.DistributedRenderer(scene(), client=client, **SIZE, **LAYERS)
    film_of(renderer, 1)
    before = len(built)
    assert before == 2  # the head node's, which builds no scene, and one of this process, where both workers are
    camera = wrt.PerspectiveCamera((2.0, 1.0, 3.0), (0.0, 0.0, 0.0))
    renderer.set_camera(camera)
    seen = film_of(renderer, 2)
    assert len(built) == before
    other = scene()
    other.camera = camera
    assert_same(seen, film_of(wrt.Renderer(other, **SIZE, **LAYERS), 2))


def test_a_window_knows_how_long_the_picture_takes(client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Alone it would be too short to load the wide kernel."""
    left, windows = [], render.render_windows
    monkeypatch.setattr(render, "render_windows", lambda *a, **k: left.append(k["seconds_left"]) or windows(*a, **k))
    film_of(wrt.distributed.DistributedRenderer(scene(), client=client, **SIZE), 64, pass_seconds=1e-3)
    assert left[0] == 0.0
    assert max(left) > 0.0


def test_workers_do_not_prepare_to_denoise(client: Any, one: wrt.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is for the whole picture, at the end."""

    def fail(renderer: wrt.Renderer) -> None:
        raise AssertionError

    monkeypatch.setattr("wrt.rendering.renderer.Guides", fail)
    noisy = scene()
    noisy.settings.denoise = True
    renderer = wrt.distributed.DistributedRenderer(noisy, client=client, **SIZE, **LAYERS)
    assert_same(film_of(renderer, 1), film_of(sharing(one), 1))


def test_a_worker_of_another_kind_renders_nothing(
    client: Any, one: wrt.Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would make other bits; what it has made is rendered again."""
    strange = sorted(client.scheduler_info()["workers"])[0]
    arithmetic_of = worker_arithmetic()

    def arithmetic(device: Any) -> dict[str, str]:
        found = arithmetic_of(device)
        if distributed.get_worker().address == strange:
            found["processor"] = "z80"
        return found

    monkeypatch.setattr("wrt.backend.arithmetic.arithmetic_of", arithmetic)
    renderer = wrt.distributed.DistributedRenderer(scene(), client=client, **SIZE, **LAYERS)
    renderer.spread.crew.kind.update(arithmetic_of(one.device))
    with pytest.warns(
        wrt.errors.InputWarning, match=rf"^worker {strange} renders nothing, these differ: processor \(z80"
    ):
        found = film_of(renderer, 9)
    assert_same(found, film_of(one, 9))
    assert set(renderer.spread.crew.refused) == {strange}
    monkeypatch.setattr("wrt._version.__version__", "0.0.1")  # of both workers, since they are here
    renderer = wrt.distributed.DistributedRenderer(scene(), client=client, **SIZE, **LAYERS)
    with (
        pytest.warns(wrt.errors.InputWarning, match=r"wrt \(0\.0\.1 there"),
        pytest.raises(wrt.InputError, match=r"no worker can render this picture: .* wrt \(0\.0\.1 there"),
    ):
        film_of(renderer, 1)


def worker_arithmetic() -> Callable[[Any], dict[str, str]]:
    from wrt.backend.arithmetic import arithmetic_of

    return arithmetic_of


def test_errors_are_one_line(client: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("wrt.distributed.clients.CONNECT_SECONDS", 0.5)
    assert main(["render", "cornell-box", "--dask", "tcp://127.0.0.1:9", "--quiet"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("wrt: error: tcp://127.0.0.1:9: there is no scheduler of Dask")
    assert error.count("\n") == 1
    assert main(["render", "cornell-box", "--dask", "local", "--part", "1/2"]) == 2
    assert "--dask renders whole pictures" in capsys.readouterr().err
    assert client_of(client) is client
    renderer = wrt.distributed.DistributedRenderer(scene(), client=client, device="cuda:9", **SIZE)
    with pytest.raises(wrt.InputError, match=r"device 'cuda:9': "):
        film_of(renderer, 1)


def test_processes_of_several_devices_render_one_picture(one: wrt.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two processes, each with a core here; one is killed meanwhile."""
    processes = wrt.distributed.Processes(["cpu", "cpu"])
    try:
        renderer = wrt.distributed.DistributedRenderer(scene(), client=processes, threads=1, **SIZE, **LAYERS)
        seen, keep = [], head._keep

        def keep_and_kill(*arguments: Any) -> None:
            keep(*arguments)
            seen.append(arguments[2])
            if len(seen) == 9:
                victims = [process.pid for process in processes._pools["0:cpu"]._processes.values()]
                os.kill(victims[0], signal.SIGKILL)

        monkeypatch.setattr(head, "_keep", keep_and_kill)
        monkeypatch.setattr("wrt.distributed.windows.SHORTEST_SECONDS", 0.0)
        assert_same(film_of(renderer, 3, 9), film_of(sharing(one), 3, 9))
        assert len(seen) > 9
        assert processes.addresses() == ["1:cpu"]
    finally:
        processes.close()


def test_names_of_several_devices(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    backend = "wrt.backend.warp_backend.WarpBackend.gpus"
    monkeypatch.setattr(backend, lambda _: 0)
    assert main(["render", "cornell-box", "--device", "cuda:0,1", "--quiet"]) == 2
    said = capsys.readouterr().err  # no driver, or no GPU
    assert said.startswith("wrt: error: device 'cuda:0,1': no ")
    assert said.endswith(" was found; use cpu\n")
    monkeypatch.setattr(backend, lambda _: 3)
    assert devices_of("cuda:all") == ["cuda:0", "cuda:1", "cuda:2"]
    assert devices_of("cuda:2,0") == ["cuda:2", "cuda:0"]
    assert [devices_of(name) for name in ("cpu", "cuda", "cuda:1", "cuda:0,", "cuda:0-2")] == [None] * 5
    for name, why in (("cuda:0,3", "only cuda:0 to cuda:2"), ("cuda:1,1", "named twice")):
        with pytest.raises(wrt.InputError, match=why):
            devices_of(name)


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 3, 7])
def test_workers_die_come_late_and_stop(workers: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """In processes of their own: one is killed, one is added, one is stopped by a signal and wakes up at the end."""
    size = {"width": 48, "height": 36, "max_depth": 3, **LAYERS}
    expected = film_of(wrt.Renderer(scene(), **size), 96)
    with (
        dask.config.set({"distributed.scheduler.worker-ttl": "1 h"}),  # a worker that hangs is there to the end
        distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        pids = list(client.run(os.getpid).values())
        happened: list[str] = []
        keep, kept = head._keep, []

        def keep_and_hurt(*arguments: Any) -> None:
            keep(*arguments)
            kept.append(arguments[2])
            if len(kept) == 4:
                os.kill(pids[0], signal.SIGKILL)
                happened.append("killed")
            if len(kept) == 8:
                cluster.scale(workers + 1)
                happened.append("added")
            if len(kept) == 12 and workers > 1:
                os.kill(pids[1], signal.SIGSTOP)
                happened.append("stopped")

        monkeypatch.setattr(head, "_keep", keep_and_hurt)
        monkeypatch.setattr("wrt.distributed.windows.SHORTEST_SECONDS", 0.05)  # many windows
        monkeypatch.setattr("wrt.distributed.dask_cluster.ANSWER_SECONDS", 1.0)
        monkeypatch.setattr("wrt.distributed.crew.LATE_SECONDS", 1.0)
        try:
            renderer = wrt.distributed.DistributedRenderer(scene(), client=client, **size)
            found = film_of(renderer, 96, pass_seconds=1.0)
        finally:
            if workers > 1:
                with contextlib.suppress(ProcessLookupError):  # Dask may have ended it
                    os.kill(pids[1], signal.SIGCONT)
        assert happened == (["killed", "added", "stopped"] if workers > 1 else ["killed", "added"])
        assert_same(found, expected)

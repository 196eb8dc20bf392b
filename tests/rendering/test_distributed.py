"""A Dask cluster, or several processes, render the bits of one machine, whatever happens to the workers."""

import contextlib
import gc
import itertools
import os
import re
import signal
import threading

import numpy as np
import pytest
from support.small_scenes import assert_same_arrays, block_scene, finish, image_of

import wrt
import wrt.distributed
from wrt.backend import processor
from wrt.cli import main
from wrt.distributed import worker
from wrt.distributed.dask_cluster import DaskCluster, client_of
from wrt.distributed.processes import devices_of
from wrt.distributed.spread import Pass, windows_of_pass

distributed = pytest.importorskip("distributed")
dask = pytest.importorskip("dask")

SIZE = {"width": 20, "height": 30, "max_depth": 3, "layers": ("albedo", "depth", "object", "crypto_material")}

pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),  # of Dask, at its end
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


def film_of(renderer, *targets, **limits):
    return finish(renderer, *targets, **limits).film.state()


def spread(client, scene=None, **options):
    return wrt.distributed.DistributedRenderer(scene or block_scene(), client=client, **{**SIZE, **options})


@pytest.fixture(scope="module")
def client():
    """Two workers in threads of this process."""
    how = {"processes": False, "dashboard_address": ":0", "protocol": "inproc://"}
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, **how) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client
    gc.collect()  # Dask's tasks log when they are deleted, and in Python 3.11 no parser may run at that time


@pytest.fixture(scope="module")
def one():
    return wrt.Renderer(block_scene(), **SIZE)


@pytest.fixture
def after_window(monkeypatch):
    """Return a function that installs a callback, which gets the number of windows whenever the film gets one."""

    def install(react):
        keep, numbers = Pass.keep, itertools.count(1)

        def keep_and_react(self, *rendered):
            keep(self, *rendered)
            react(next(numbers))

        monkeypatch.setattr(Pass, "keep", keep_and_react)

    return install


def kill(processes):
    """Kill the first of the processes that live."""
    for pool in list(processes._pools.values())[:1]:
        os.kill(next(iter(pool._processes)), signal.SIGKILL)


@pytest.mark.parametrize("workers", [0, 3, 1000])
@pytest.mark.parametrize("seconds", [0.0, 1e-9, 1e-3, 10.0])
def test_windows_cover_a_pass_once_and_shrink(workers, seconds):
    covered, heights = np.zeros((100, 64), int), []
    for x0, y0, x1, y1 in windows_of_pass((3, 5, 67, 105), lambda: workers, lambda: seconds):
        covered[y0 - 5 : y1 - 5, x0 - 3 : x1 - 3] += 1
        heights.append(y1 - y0)
    assert (covered == 1).all()
    assert heights[-1] <= heights[0]
    if workers == 3 and seconds == 0.0:
        assert (heights[0], heights[-1]) == (100 // 6, 1)


def test_the_film_is_that_of_one_machine_and_goes_on_from_a_checkpoint(client, one, tmp_path):
    renderer = spread(client)
    film_of(renderer, 3)
    renderer.save_checkpoint(tmp_path / "a.ckpt")
    film_of(one, 9)
    resumed = spread(client)
    resumed.load_checkpoint(tmp_path / "a.ckpt")
    single = wrt.Renderer.resume(tmp_path / "a.ckpt", block_scene())
    for each in (renderer, resumed, single):
        assert_same_arrays(film_of(each, 9), one.film.state())
    assert renderer.rays == one.rays
    assert renderer.noise() == one.noise()


def test_a_crop_whose_pixels_share_samples(client):
    """Its film has pixels beside the crop, which workers render, too."""
    options = {"crop": (3, 0, 15, 29), "filter": "shared"}
    renderer, one = spread(client, **options), wrt.Renderer(block_scene(), **{**SIZE, **options})
    assert_same_arrays(film_of(renderer, 3), film_of(one, 3))
    np.testing.assert_array_equal(renderer.image(), one.image())
    assert_same_arrays(renderer.layers(), one.layers())


def test_shadow_catchers_have_a_second_film_on_the_cluster(client):
    scene = block_scene()
    scene.add(wrt.quad((-2, -0.5, 2), (4, 0, 0), (0, 0, -4)), shadow_catcher=True)
    renderer, one = spread(client, scene, layers=()), wrt.Renderer(scene, **{**SIZE, "layers": ()})
    other = wrt.PerspectiveCamera((1.0, 1.0, 4.0), (0.0, 0.0, 0.0))
    for camera in (None, other):
        for each in (renderer, one):
            if camera is not None:
                each.set_camera(camera)
            finish(each, 3)
        picture = renderer.finished()
        np.testing.assert_array_equal(picture, one.finished())
        assert ((picture[..., 3] > 0.0) & (picture[..., 3] < 1.0)).mean() > 0.1


@pytest.mark.slow
def test_a_target_of_noise(client, tmp_path):
    """The samples at which it ends, and the tiles that stop before, follow from the film."""
    limits = {"noise": 0.08, "adaptive": True}
    single = finish(wrt.Renderer(block_scene(), **SIZE), **limits)
    picture = wrt.render(block_scene(), client=client, **SIZE, **limits)["image"]
    np.testing.assert_array_equal(picture, single.image())
    # Also after a render that was ended on a cluster goes on there.
    renderer = spread(client)
    next(iter(renderer.passes(**limits, pass_seconds=1e-3)))
    renderer.save_checkpoint(tmp_path / "a.ckpt")
    resumed = spread(client)
    resumed.load_checkpoint(tmp_path / "a.ckpt")
    assert_same_arrays(film_of(resumed, **limits), single.film.state())


def test_workers_are_counted_while_dask_renews_what_it_knows_of_them(client, monkeypatch):
    """Every two seconds a client replaces its copy of the scheduler's state by one without workers."""
    sync = client.sync

    def sync_and_renew(*arguments, **options):
        found = sync(*arguments, **options)
        sync(client._update_scheduler_info, n_workers=0)
        return found

    monkeypatch.setattr(client, "sync", sync_and_renew)
    assert len(DaskCluster(client).addresses()) == 2


def test_a_worker_of_another_kind_renders_nothing(client, one, monkeypatch):
    """It would make other bits; its windows are rendered again."""
    strange = sorted(client.scheduler_info()["workers"])[0]
    arithmetic_of = processor.arithmetic_of

    def of_worker(device):
        odd = {"processor": "z80"} if distributed.get_worker().address == strange else {}
        return {**arithmetic_of(device), **odd}

    monkeypatch.setattr(processor, "arithmetic_of", of_worker)
    renderer = spread(client)
    renderer.spread.crew.kind.update(arithmetic_of(one.device))
    warning = rf"^worker {strange} renders nothing, these differ: processor \(z80"
    with pytest.warns(wrt.errors.InputWarning, match=warning):
        found = film_of(renderer, 9)
    assert_same_arrays(found, film_of(one.sharing(), 9))
    assert set(renderer.spread.crew.refused) == {strange}
    monkeypatch.setattr("wrt._version.__version__", "0.0.1")  # of both workers, since they are here
    with (
        pytest.warns(wrt.errors.InputWarning, match=r"wrt \(0\.0\.1 there"),
        pytest.raises(wrt.InputError, match=r"no worker can render this picture: .* wrt \(0\.0\.1 there"),
    ):
        film_of(spread(client), 1)


def test_a_worker_that_builds_a_scene_mutes_no_other_thread(monkeypatch):
    """Workers may be threads of the head's process, which can warn of an idle worker at the same time."""

    def build(scene, **_):
        wrt.errors.warn("of the scene")
        head = threading.Thread(target=wrt.errors.warn, args=("of the head",))
        head.start()
        head.join()
        return scene

    monkeypatch.setattr("wrt.rendering.renderer.Renderer", build)
    with pytest.warns(wrt.InputWarning) as warned:
        worker._build(worker.Job("digest", {"threads": 1}, None), block_scene())
    worker._renderers.pop("digest")
    assert [str(each.message) for each in warned] == ["of the head"]


def test_errors_are_one_line(client, monkeypatch, capsys):
    monkeypatch.setattr("wrt.distributed.dask_cluster.CONNECT_SECONDS", 0.5)
    assert main(["render", "cornell-box", "--dask", "tcp://127.0.0.1:9", "--quiet"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("wrt: error: tcp://127.0.0.1:9: there is no scheduler of Dask")
    assert error.count("\n") == 1
    assert main(["render", "cornell-box", "--dask", "local", "--part", "1/2"]) == 2
    assert "--dask renders whole pictures" in capsys.readouterr().err
    assert client_of(client) is client
    with pytest.raises(wrt.InputError, match=r"device 'cuda:9': "):
        film_of(spread(client, device="cuda:9"), 1)


@pytest.mark.slow
def test_processes_of_several_devices_render_one_picture(one, monkeypatch, after_window):
    """Two processes, each with a core here; the first is killed."""
    processes = wrt.distributed.Processes(["cpu", "cpu"])
    windows = []

    def react(number):
        windows.append(number)
        if number == 9:
            kill(processes)

    try:
        renderer = spread(processes, threads=1)
        after_window(react)
        monkeypatch.setattr("wrt.distributed.spread.SHORTEST_SECONDS", 0.0)
        assert_same_arrays(film_of(renderer, 3, 9), film_of(one.sharing(), 3, 9))
        assert len(windows) > 9
        assert processes.addresses() == ["1:cpu"]
    finally:
        processes.close()


def test_names_of_several_devices(monkeypatch, capsys):
    monkeypatch.setattr("wrt.backend.backend.Backend.gpus", lambda _: 0)
    assert main(["render", "cornell-box", "--device", "cuda:0,1", "--quiet"]) == 2
    error = capsys.readouterr().err  # no driver, or no GPU
    assert error.startswith("wrt: error: device 'cuda:0,1': no ")
    assert error.endswith(" was found; use cpu\n")
    monkeypatch.setattr("wrt.backend.backend.Backend.gpus", lambda _: 3)
    assert devices_of("cuda:all") == ["cuda:0", "cuda:1", "cuda:2"]
    assert devices_of("cuda:2,0") == ["cuda:2", "cuda:0"]
    assert [devices_of(name) for name in ("cpu", "cuda", "cuda:1", "cuda:0,", "cuda:0-2")] == [None] * 5
    for name, message in (("cuda:0,3", "only cuda:0 to cuda:2"), ("cuda:1,1", "named twice")):
        with pytest.raises(wrt.InputError, match=message):
            devices_of(name)


def test_the_command_line_saves_what_there_is_when_the_scheduler_is_lost(tmp_path, monkeypatch, capsys, after_window):
    """After the fourth window; and the checkpoint goes on to the film of one machine."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("wrt.distributed.spread.SHORTEST_SECONDS", 0.0)
    how = {"processes": False, "dashboard_address": ":0", "silence_logs": 50}
    options = ("--dask", "there", "--spp", "64", "--size", "20x30", "--checkpoint", "a.ckpt", "-o", "a.png", "--quiet")
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "200ms"}),
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, **how) as cluster,
        distributed.Client(cluster.scheduler_address, timeout=0.2) as client,
    ):
        after_window(lambda number: cluster.close() if number == 4 else None)
        monkeypatch.setattr("wrt.cli.options._client", lambda _: client)
        assert main(["render", "cornell-box", *options]) == 1
    pattern = "wrt: error: the connection to the scheduler of Dask is lost; stopped at .*; a.png and a.ckpt saved\n"
    assert re.fullmatch(pattern, capsys.readouterr().err)
    assert wrt.load_image("a.png").shape == (30, 20, 3)
    resumed = wrt.Renderer.resume("a.ckpt", wrt.load("cornell-box"))
    assert 0 < resumed.film.counts.max() < 64
    np.testing.assert_array_equal(image_of(resumed, 64), wrt.render("cornell-box", width=20, height=30, spp=64))


def test_a_process_that_dies_leaves_the_film(after_window):
    """Of several the next goes on; see `test_processes_of_several_devices_render_one_picture`."""
    processes = wrt.distributed.Processes(["cpu"])
    after_window(lambda _: kill(processes))
    try:
        with pytest.raises(wrt.distributed.ClusterError, match="the processes that render have died") as caught:
            # Its kernel is one that other tests compile in processes, too.
            film_of(spread(processes, wrt.load("cornell-box"), threads=1, layers=()), 64)
        assert caught.value.renderer.film.counts.any()
    finally:
        processes.close()


def test_what_a_worker_raises_is_an_error_of_the_cluster(client, monkeypatch):
    renderer = film = spread(client)
    film_of(renderer, 1)
    for error, message in (
        (RuntimeError("CUDA error"), r"a worker failed: RuntimeError\('CUDA error'\)"),
        (wrt.InputError("too large"), "too large"),
    ):

        def fail(*_, error=error, **__):
            raise error

        monkeypatch.setattr(wrt.Renderer, "of_window", fail)
        with pytest.raises(wrt.distributed.ClusterError, match=message) as caught:
            film_of(renderer, 64)
        assert caught.value.renderer is film


def test_a_person_is_told_that_there_is_no_worker(monkeypatch):
    monkeypatch.setattr("wrt.distributed.spread.MENTIONED_SECONDS", 0.0)
    monkeypatch.setattr("wrt.distributed.spread.WITHOUT_WORKERS_SECONDS", 0.5)
    with (
        distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=":0", protocol="inproc://") as cluster,
        distributed.Client(cluster) as client,
        pytest.warns(wrt.errors.InputWarning, match="the scheduler has no worker; waiting for one") as warned,
        pytest.raises(wrt.distributed.ClusterError, match="has had no worker for"),
    ):
        film_of(spread(client), 1)
    assert len(warned) == 1


@pytest.mark.slow
def test_workers_die_come_late_and_stop(monkeypatch, after_window):
    """Processes: one is killed, one is added, one is stopped by a signal and continues at the end."""
    size = {**SIZE, "width": 48, "height": 36}
    expected = film_of(wrt.Renderer(block_scene(), **size), 192)
    how = {"processes": True, "dashboard_address": ":0", "silence_logs": 50}
    with (
        dask.config.set({"distributed.scheduler.worker-ttl": "3 s"}),  # then a worker that hangs counts as dead
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, **how) as cluster,
        distributed.Client(cluster) as client,
    ):
        pids = list(client.run(os.getpid).values())
        events = {4: lambda: os.kill(pids[0], signal.SIGKILL), 8: lambda: cluster.scale(3)}
        events[12] = lambda: os.kill(pids[1], signal.SIGSTOP)
        after_window(lambda number: events.pop(number, lambda: None)())
        monkeypatch.setattr("wrt.distributed.spread.SHORTEST_SECONDS", 0.05)  # many windows
        monkeypatch.setattr("wrt.distributed.dask_cluster.ANSWER_SECONDS", 1.0)
        try:
            found = film_of(spread(client, **size), 192, pass_seconds=1.0)
        finally:
            with contextlib.suppress(ProcessLookupError):  # Dask may have ended it
                os.kill(pids[1], signal.SIGCONT)
        assert not events
        assert_same_arrays(found, expected)

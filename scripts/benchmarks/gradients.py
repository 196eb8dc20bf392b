"""`gradients`: derivatives of pictures beside wrt's own renders and Mitsuba's `prb` (Vicini et al. 2021)."""

from __future__ import annotations

import argparse
import statistics
import tempfile
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from peers.peer import LLVM_HINT, OWN, PEERS, Environments, PeerError, Session

from benchmarks.gradient_scenes import SCENES, Arrays, Compared, compared
from benchmarks.measure import Row, table

MITSUBA = PEERS["mitsuba-llvm"]


def benchmark(options: argparse.Namespace) -> Row:
    """Return seconds of CPU of gradients and renders, their ratios, and z-values between the gradients."""
    rows = []
    with tempfile.TemporaryDirectory() as cache:
        for name in options.scenes:
            with tempfile.TemporaryDirectory() as folder:
                rows.append(measured(name, Path(folder), Path(cache), options))
            print(texts_of([rows[-1]]), flush=True)
    settings = {key: getattr(options, key) for key in ("size", "spp", "depth", "seeds")}
    return {"benchmark": "gradients", "rows": rows, **settings}


def measured(name: str, folder: Path, cache: Path, options: argparse.Namespace) -> Row:
    """Return the results of a scene; `repeats` of 0 give no seconds."""
    size = options.size
    scene = compared(name, folder, size, options.depth)
    d_image = folder / "d_image.npy"
    np.save(d_image, np.random.default_rng(0).uniform(0.5, 1.5, (size, size, 3)).astype(np.float32) / size**2)
    question = {"d_image": str(d_image), "spp": options.spp, "save": str(folder / "gradients.npz")}

    def gradients(session: Session, keys: list[str], seed: int) -> tuple[float, dict[str, NDArray[np.float64]]]:
        seconds = session.ask(do="gradients", names=keys, seed=seed, **question)["cpu_seconds"]
        with np.load(question["save"]) as found:
            return seconds, {key: found[key].astype(np.float64) for key in keys}

    def render(session: Session, seed: int) -> float:
        return float(session.ask(do="render", spp=options.spp, seed=seed)["cpu_seconds"])

    own_cache = {"XDG_CACHE_HOME": str(cache), "WRT_BACKGROUND": "0"}
    environments = Environments(llvm=options.llvm, more=own_cache)
    scalar = Environments(more=own_cache | {"WRT_WIDE": "0"})
    row: Row = {"scene": name}
    seconds: dict[str, list[float]] = {}
    found: dict[str, list[Arrays]] = {"wrt": [], "mitsuba": []}
    with ExitStack() as stack:
        wide = stack.enter_context(Session(OWN, folder, environments, threads=1))
        row["cold"] = gradients(wide, scene.ours, 0)[0]
        narrow = stack.enter_context(Session(OWN, folder, scalar, threads=1)) if options.repeats else None
        mitsuba = start_mitsuba(scene, folder, environments)
        row["mitsuba"] = mitsuba
        if isinstance(mitsuba, Session):
            stack.enter_context(mitsuba)
            row["mitsuba"] = mitsuba.about["variant"]
            gradients(mitsuba, scene.theirs, 0)
        for seed in range(1, 1 + options.seeds):
            times = {}
            times["wrt"], values = gradients(wide, scene.ours, seed)
            found["wrt"].append(scene.from_ours(values))
            if isinstance(mitsuba, Session):
                times["mitsuba"], values = gradients(mitsuba, scene.theirs, seed)
                found["mitsuba"].append(scene.from_theirs(values))
            if narrow and seed <= options.repeats:
                times["wrt as rendered"], times["wrt scalar"] = render(wide, seed), render(narrow, seed)
                if isinstance(mitsuba, Session):
                    times["mitsuba rendered"] = render(mitsuba, seed)
            for key, value in times.items():
                seconds.setdefault(key, []).append(value)
    row["seconds"] = {key: statistics.median(values) for key, values in seconds.items()}
    if found["mitsuba"]:
        keys = found["mitsuba"][0]
        row["agreement"] = {key: agreement(*([each[key] for each in found[k]] for k in found)) for key in keys}
    return row


def start_mitsuba(scene: Compared, folder: Path, environments: Environments) -> Session | str:
    """Return Mitsuba with the scene, or why there is none; its scalar variants have no derivatives."""
    try:
        scene.prepare_mitsuba()
        return Session(MITSUBA, folder, environments, threads=1)
    except (PeerError, ImportError) as error:
        return f"none: {error}"


def agreement(ours: list[NDArray[np.float64]], theirs: list[NDArray[np.float64]]) -> Row:
    """Return means over seeds of both gradients' sums, their z, and the largest z of single values.

    The difference of the sums has the standard error `error`, relative to Mitsuba's.
    """

    def errors(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.sqrt(a.var(axis=0, ddof=1) / len(a) + b.var(axis=0, ddof=1) / len(b)))

    def z(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        error, difference = errors(a, b), a.mean(axis=0) - b.mean(axis=0)
        return np.divide(difference, error, out=np.zeros_like(difference), where=error > 0.0)

    a, b = (np.stack(each).reshape(len(each), -1) for each in (ours, theirs))
    return {
        "wrt": float(a.sum(axis=1).mean()),
        "mitsuba": float(b.sum(axis=1).mean()),
        "z": float(z(a.sum(axis=1), b.sum(axis=1))),
        "error": float(errors(a.sum(axis=1), b.sum(axis=1)) / abs(b.sum(axis=1).mean())),
        "largest_z": float(np.abs(z(a, b)).max()),
        "values": a.shape[1],
    }


def texts_of(rows: list[Row]) -> str:
    """Return the tables of some scenes."""
    head = ["scene", "wrt, seconds of CPU", "cold", "/ wrt scalar", "/ wrt as rendered", "Mitsuba `prb` / wrt"]
    lines, others = [], []
    for row in rows:
        seconds = row["seconds"]
        ratios = [f"{seconds['wrt'] / seconds[key]:.2f}" for key in ("wrt scalar", "wrt as rendered")]
        peer = f"{seconds['mitsuba'] / seconds['wrt']:.2f}" if "mitsuba" in seconds else row["mitsuba"]
        lines.append([f"`{row['scene']}`", f"{seconds['wrt']:.3f}", f"{row['cold']:.1f}", *ratios, peer])
        for key, of in row.get("agreement", {}).items():
            numbers = [f"{of['wrt']:.5g}", f"{of['mitsuba']:.5g}", f"{of['z']:+.2f}", f"{of['largest_z']:.2f}"]
            others.append([f"`{row['scene']}`", f"`{key}`", *numbers, str(of["values"])])
    agreement_head = ["scene", "parameter", "sum, wrt", "Mitsuba", "z", "largest z of one value", "values"]
    return table(head, lines) + ("\n" + table(agreement_head, others) if others else "")


def text(result: Row) -> str:
    """Return the tables of the result."""
    size = f"{result['size']} x {result['size']} pixels, {result['spp']} samples, depth {result['depth']}"
    variants = ", ".join(dict.fromkeys(row["mitsuba"] for row in result["rows"]))
    return f"On {result['machine']}, one thread; {size}; Mitsuba: {variants}.\n\n{texts_of(result['rows'])}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=SCENES, metavar="NAME")
    parser.add_argument("--size", type=int, default=64, help="pixels on each side (default: 64)")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--depth", type=int, default=5, help="most segments of a path (default: 5)")
    parser.add_argument("--repeats", type=int, default=5, help="renders that are timed (default: 5)")
    parser.add_argument("--seeds", type=int, default=32, help="gradients that are timed and compared (default: 32)")
    parser.add_argument("--llvm", type=Path, metavar="FOLDER", help=LLVM_HINT)

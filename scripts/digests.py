"""Record or check digests of the films of tests/running/test_digests.py, and write the generated C++.

python scripts/digests.py record           write tests/data/digests.json for this machine's arithmetic
python scripts/digests.py check            compare with it, with the scalar and the wide kernel
python scripts/digests.py code FOLDER      write the C++ of every kernel variant to FOLDER, for `diff -r`
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(ROOT / "scripts")]
# No general kernel stands in for the scalar one, which the films are recorded with.
os.environ.update(WRT_WIDE="0", WRT_BACKGROUND="0")
RECORDED = ROOT / "tests" / "data" / "digests.json"


def record() -> int:
    """Write the digests of all films of the scalar kernel; other arithmetics lose films that changed here."""
    from support.digests import arithmetic, cases, scalar_film

    films = {}
    for name, case in cases().items():
        films[name] = scalar_film(case)
        print(f"{name}: {films[name]}", flush=True)
    recorded = _recorded()
    before = recorded.pop(arithmetic(), {})
    stale = {name for name, digest in before.items() if films.get(name) != digest}
    unchanged = {
        kind: {name: digest for name, digest in each.items() if name not in stale} for kind, each in recorded.items()
    }
    sections = {**unchanged, arithmetic(): dict(sorted(films.items()))}
    RECORDED.write_text(json.dumps(dict(sorted(sections.items())), indent=2) + "\n", encoding="utf-8")
    return 0


def _recorded() -> dict[str, dict[str, str]]:
    """Return the recorded films by kind of arithmetic."""
    sections: dict[str, dict[str, str]] = json.loads(RECORDED.read_text(encoding="utf-8"))
    return sections


def check(kernels: list[str], lanes: int, pattern: str) -> int:
    """Compare films with the recorded digests, and print the differences."""
    from support.digests import arithmetic, cases, scalar_film, wide_film

    recorded = _recorded().get(arithmetic(), {})
    if not recorded:
        print("films were recorded with other arithmetic: record them here from the commit before")
        return 2
    wrong = compared = 0
    for name, case in cases().items():
        if name not in recorded or not re.search(pattern, name):
            continue
        for kernel in kernels:
            started = time.perf_counter()
            film = scalar_film(case) if kernel == "scalar" else wide_film(case, lanes)
            if film is None:
                continue  # the integrator has no wide kernel
            compared += 1
            wrong += film != recorded[name]
            verdict = "the same" if film == recorded[name] else "DIFFERS"
            print(f"{name}, {kernel}: {verdict} ({time.perf_counter() - started:.1f} s)", flush=True)
    print(f"{compared} films compared, {wrong} differ")
    return int(wrong > 0)


def code(folder: Path, lanes: int) -> int:
    """Write the C++ of the kernels for every tested set of features, and of all other kernels."""
    import warp as wp
    from support.feature_sets import FEATURES, declared_kernels
    from warp._src.context import ModuleBuilder

    from wrt.backend.warp_start import initialize_warp
    from wrt.kernels.render import make_render_kernel
    from wrt.spmd.ir import Unsupported
    from wrt.spmd.translate import wide_code

    initialize_warp()
    folder.mkdir(parents=True, exist_ok=True)
    modules = {f"{i:02}_{f.name}": make_render_kernel(f).module for i, f in enumerate(FEATURES)}
    modules |= {kernel.module.name: kernel.module for kernel in declared_kernels().values()}
    for name, module in modules.items():
        for target in ("cpu", "cuda"):
            builder = ModuleBuilder(module, module.resolve_options(wp.config), target=None)
            (folder / f"{name}.{target}.cpp").write_text(_normalised(builder.codegen(target)), encoding="utf-8")
    for i, features in enumerate(FEATURES):
        try:
            text = wide_code(make_render_kernel(features), lanes)
        except Unsupported as error:
            text = f"{error}\n"
        (folder / f"{i:02}_{features.name}.wide.cpp").write_text(_normalised(text), encoding="utf-8")
    return 0


def _normalised(text: str) -> str:
    """Return C++ without Python's line numbers and files, and without hashes in names."""
    text = re.sub(r"//.*", "", text)
    text = re.sub(r"_[0-9a-f]{8}(?=_|\b)", "_HASH", text)
    return re.sub(r"[ \t]+$", "", re.sub(r"\n\s*\n+", "\n", text), flags=re.MULTILINE)


def main() -> int:
    """Run the command line."""
    from wrt.backend.processor import WIDTHS, lanes_of, processor_flags

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["record", "check", "code"])
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--kernel", choices=["scalar", "wide"], action="append")
    parser.add_argument("--lanes", type=int, choices=WIDTHS, default=lanes_of(processor_flags()) or min(WIDTHS))
    parser.add_argument("--only", default="", help="regular expression of names")
    options = parser.parse_args()
    if options.what == "record":
        return record()
    if options.what == "check":
        return check(options.kernel or ["scalar", "wide"], options.lanes, options.only)
    if options.folder is None:
        parser.error("code: name a folder")
    return code(options.folder, options.lanes)


if __name__ == "__main__":
    sys.exit(main())

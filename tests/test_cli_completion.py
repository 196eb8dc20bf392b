"""With the output of `wrt completion`, shells complete commands, options, their values, scenes and files."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from test_cli import ENVIRONMENT, run

from wrt.scene.scene import INTEGRATORS, SAMPLERS

SCENES = ["cornell-box", "many-triangles", "still-life", "teapot"]

EXPECTED = {
    "wrt ": [
        "compile",
        "completion",
        "convert",
        "develop",
        "info",
        "materials",
        "merge",
        "render",
        "scenes",
        "schema",
        "view",
    ],
    "wrt ren": ["render"],
    "wrt render ": sorted([*SCENES, "bunny.obj", "room.toml", "sub/", "two words.ply"]),
    "wrt render bu": ["bunny.obj"],
    "wrt render sub/": ["sub/scene.xml"],
    "wrt render teapot bu": ["bunny.obj"],
    "wrt render teapot --max": ["--max-depth"],
    "wrt render teapot --integrator ": sorted(INTEGRATORS),
    "wrt render teapot --sampler ": sorted(SAMPLERS),
    "wrt render teapot --device cu": ["cuda", "cuda:0"],
    "wrt render teapot --layers albedo,no": ["albedo,normal"],
    "wrt render teapot --size 1": ["1080p", "1440p"],
    "wrt render teapot -o ": ["old.png", "sub/"],
    "wrt render teapot --spp ": [],
    "wrt materials rough-": ["rough-conductor", "rough-dielectric", "rough-plastic"],
    "wrt info bu": ["bunny.obj"],
    "wrt compile bu": ["bunny.obj"],
    "wrt compile teapot --integrator ": sorted(INTEGRATORS),
    "wrt completion ": ["bash", "fish", "zsh"],
}

BASH = """
shopt -s extglob
eval "$(wrt completion bash)"
while IFS= read -r COMP_LINE; do
    COMP_POINT=${#COMP_LINE} COMP_TYPE=9 COMP_KEY=9 COMPREPLY=()
    read -ra COMP_WORDS <<<"$COMP_LINE"
    [[ $COMP_LINE == *" " ]] && COMP_WORDS+=("")
    COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
    function=$(complete -p wrt | sed 's/.*-F \\([^ ]*\\).*/\\1/')
    "$function" wrt "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
    for word in "${COMPREPLY[@]}"; do printf '%s\\n' "${word//\\\\/}"; done
    echo .
done
"""

FISH = """
wrt completion fish | source
while read -l line
    complete -C "$line"
    echo .
end
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("files")
    for name in ("bunny.obj", "bunny.txt", "room.toml", "old.png", "two words.ply", ".hidden.obj", "sub/scene.xml"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).touch()
    # A launcher like the installed one.
    (folder / ".bin").mkdir()
    program = folder / ".bin" / "wrt"
    program.write_text(f"#!{sys.executable}\nfrom wrt.__main__ import run\nrun()\n")
    program.chmod(0o755)
    return folder


@pytest.mark.parametrize(("shell", "script"), [("bash", BASH), ("fish", FISH)])
def test_words_are_completed(shell: str, script: str, folder: Path) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell} here")
    environment = {
        **ENVIRONMENT,
        "PATH": f"{folder / '.bin'}{os.pathsep}{os.environ['PATH']}",
        "HOME": str(folder / ".bin"),
    }
    lines = "".join(f"{line}\n" for line in EXPECTED)
    done = subprocess.run(
        [shell, "-c", script], cwd=folder, env=environment, input=lines, capture_output=True, text=True, check=False
    )
    assert done.stderr == ""
    answers = done.stdout.split(".\n")[:-1]
    assert len(answers) == len(EXPECTED)
    for (line, words), answer in zip(EXPECTED.items(), answers, strict=True):
        assert sorted(word.partition("\t")[0].rstrip() for word in answer.splitlines()) == words, line


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_shells_understand_what_is_printed(shell: str, tmp_path: Path) -> None:
    printed = run(tmp_path, "completion", shell)
    assert (printed.returncode, printed.stderr) == (0, "")
    assert "wrt" in printed.stdout
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell} here")
    (tmp_path / "script").write_text(printed.stdout)
    assert subprocess.run([shell, "-n", tmp_path / "script"], capture_output=True, check=True).stderr == b""


def test_nothing_of_it_is_imported_otherwise(tmp_path: Path) -> None:
    code = "import sys; from wrt.cli import main; main(['scenes']); assert 'argcomplete' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=ENVIRONMENT, check=True, stdout=subprocess.DEVNULL)

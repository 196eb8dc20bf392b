"""With the output of `wrt completion`, shells complete commands, options, their values, scenes and files."""

import os
import subprocess
import sys

from support.commands import ENVIRONMENT

SCENES = ["cornell-box", "many-triangles", "still-life", "teapot"]
COMMANDS = "compile completion convert develop info materials merge render scenes schema view"

EXPECTED = {
    "wrt ": COMMANDS.split(),
    "wrt render ": sorted([*SCENES, "bunny.obj", "room.toml", "sub/", "two words.ply"]),
    "wrt render sub/": ["sub/scene.xml"],
    "wrt render teapot --max": ["--max-depth"],
    "wrt render teapot --layers albedo,no": ["albedo,normal"],
    "wrt render teapot -o ": ["old.png", "sub/"],
    "wrt materials rough-": ["rough-conductor", "rough-dielectric", "rough-plastic"],
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


def test_words_are_completed(tmp_path):
    for name in ("bunny.obj", "bunny.txt", "room.toml", "old.png", "two words.ply", ".hidden.obj", "sub/scene.xml"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    program = tmp_path / ".bin" / "wrt"  # a launcher like the installed one
    program.parent.mkdir()
    program.write_text(f"#!{sys.executable}\nfrom wrt.__main__ import run\nrun()\n")
    program.chmod(0o755)
    path = f"{program.parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**ENVIRONMENT, "PATH": path, "HOME": str(program.parent)}
    lines = "".join(f"{line}\n" for line in EXPECTED)
    command = ["bash", "-c", BASH]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, input=lines, capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    answers = [sorted(word.rstrip() for word in answer.splitlines()) for answer in done.stdout.split(".\n")[:-1]]
    assert dict(zip(EXPECTED, answers, strict=True)) == EXPECTED

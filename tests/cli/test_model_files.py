"""`--with my_models.py` and `wrt.load_models`: a person's file is run on purpose, and its faults are one line."""

from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT
from support.commands import run

import wrt
from wrt.backend import user_code
from wrt.cli import main
from wrt.kernels.bsdf import BSDFS
from wrt.scene.materials import MATERIALS

CODE = (ROOT / "tests/support/moon.py").read_text("utf-8")

SCENE = """
[materials.dust]
type = "lunar"
[[shapes]]
type = "sphere"
material = "dust"
[environment]
type = "constant"
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.chdir(tmp_path)
    Path("moon_models.py").write_text(CODE)
    Path("moon.toml").write_text(SCENE)
    return tmp_path


def test_scene_files_name_the_models_of_a_file(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without the option nothing is run."""
    assert main(["info", "moon.toml"]) == 2
    assert "not 'lunar'" in capsys.readouterr().err
    done = run(folder, "info", "moon.toml", "--with", "moon_models.py")
    assert "1 material" in done.stdout, done.stderr


@pytest.mark.slow
def test_pictures_of_them(folder: Path) -> None:
    own, small = ("moon.toml", "--with", "moon_models.py"), ("--size", "16x12", "--spp", "1")
    for command in (
        ("render", *own, *small, "-o", "moon.npy"),
        ("compile", *own, *small[:2]),
        ("materials", "lunar", *own[1:]),
    ):
        done = run(folder, *command)
        assert (done.returncode, done.stderr.count("error")) == (0, 0), done.stderr
    assert wrt.load_image("moon.npy").max() > 0.0


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("x = 1\ndef f(:\n", r"my\.py, line 2: invalid syntax"),
        ("import wrt\n\nx = 1 / 0\n", r"my\.py, line 3: ZeroDivisionError: division by zero"),
        ("import wrt\nimport nothing_such\n", r"my\.py, line 2: ModuleNotFoundError: No module named 'nothing_such'"),
        ("raise SystemExit(3)\n", r"my\.py, line 1: SystemExit: 3"),
        ("x = 1\n", r"my\.py: registers nothing; it should call wrt\.register_material"),
        (CODE.replace('"lunar"', '"diffuse"'), r"my\.py, line \d+: Lunar: type_name 'diffuse' is empty or taken"),
        (None, r"my\.py: no such file"),
    ],
)
def test_faults_of_a_file_are_one_line(code: str | None, message: str, folder: Path) -> None:
    if code is not None:
        Path("my.py").write_text(code)
    with pytest.raises(wrt.InputError, match=f"^{message}"):
        wrt.load_models("my.py")


def test_a_file_is_loaded_again_after_a_change(folder: Path) -> None:
    try:
        assert wrt.load_models("moon_models.py") == ["lunar"]
        first = MATERIALS["lunar"]
        assert wrt.load_models("moon_models.py") == ["lunar"]
        assert MATERIALS["lunar"] is not first
        Path("numpy.py").write_text(CODE)
        with pytest.raises(wrt.InputError, match="Python has another module 'numpy'"):
            wrt.load_models("numpy.py")
    finally:
        MATERIALS.pop("lunar", None)
        BSDFS.forget("lunar")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--confined",), "--with runs a program, which --confined forbids"),
        (("--device", "cuda:all"), "--with: other processes do not have the models"),
    ],
)
def test_where_it_is_refused(
    options: tuple[str, ...], message: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["render", "moon.toml", "--with", "moon_models.py", *options]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_what_warp_cannot_compile_is_named_with_its_line() -> None:
    nested = (
        'Error while parsing function "render_pass" at /x/render.py:94:\n    result = trace(scene)\n;'
        'Error while parsing function "evaluate" at /x/my_models.py:18:\n    if foo(wi) <= 0.0:\n;'
        "Referencing undefined symbol: foo"
    )
    with (
        pytest.raises(wrt.InputError, match=r"^/x/my_models\.py, line 18: evaluate: `if foo\(wi\) <= 0\.0:`: Refer"),
        user_code.naming_faults(),
    ):
        raise KeyError(nested)
    with pytest.raises(KeyError, match="render_pass"), user_code.naming_faults():
        raise KeyError(nested.replace("/x/my_models.py", str(Path(user_code.__file__).parents[1] / "kernels/a.py")))

"""USD files that name what may not be read, multiply without end, or are damaged: refused in one line, or shown."""

import io
import os
import zipfile

import numpy as np
import pytest
from support.mesh_files import check_refused
from support.meshes import write

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import animation_of, load_file
from wrt.io.usd import process

pytest.importorskip("pxr")

MESH = """def Mesh "m" {
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
}
"""
OUTSIDE = "is outside the scene's folder, and reading is confined to that"


def usd(*metadata: str, prims: str = "") -> str:
    return "\n".join(["#usda 1.0", "(", "metersPerUnit = 1", *metadata, ")", prims])


def clips(values: str) -> str:
    sets = f'dictionary default = {{\nstring primPath = "/m"\ndouble2[] active = [(0, 0)]\n{values}\n}}'
    return f'def Xform "a" (clips = {{\n{sets}\n}}) {{\ndouble x\n}}\n'


def naming(name: str) -> dict[str, str]:
    """Return stages that name another layer in each of the ways that composing may follow."""
    chosen = 'variants = {\nstring v = "b"\n}\nvariantSets = "v"'
    return {
        "sublayer": usd(f"subLayers = [@{name}@]", prims=MESH),
        "reference": usd(prims=f'{MESH}def "a" (references = @{name}@) {{}}'),
        "payload": usd(prims=f'{MESH}def "a" (prepend payload = @{name}@) {{}}'),
        "variant": usd(
            prims=f'{MESH}def "a" ({chosen}) {{\nvariantSet "v" = {{\n"b" (references = @{name}@) {{}}\n}}\n}}'
        ),
        "expression": usd(
            f'expressionVariables = {{\nstring N = "{name}"\n}}',
            prims=f'{MESH}def "a" (references = @`"${{N}}"`@) {{}}',
        ),
    }


@pytest.mark.parametrize("kind", naming(""))
def test_no_pipe_and_nothing_outside_a_confinement_is_opened(kind, tmp_path):
    """Opening the pipe would never end."""
    inside = tmp_path / "inside"
    inside.mkdir()
    os.mkfifo(tmp_path / "pipe.usda")
    path = write(inside, f"{kind}.usda", naming("../pipe.usda")[kind])
    names = ("../{}.usda", "a/../../{}.usda", f"{tmp_path}/{{}}.usda")
    for name in names if kind == "reference" else names[:1]:
        messages = []
        for target in ("pipe", "none"):  # the message is the same for both
            path.write_text(naming(name.format(target))[kind])
            with pytest.raises(wrt.InputError, match=OUTSIDE) as caught:
                wrt.load(path, confined=True)
            messages.append(str(caught.value).replace(f"{target}.usda", ""))
        assert messages[0] == messages[1]
    path.write_text(naming("../pipe.usda")[kind])
    check_refused(r"pipe\.usda: is a pipe or a device, not a file", load_file, path)


def test_images_outside_a_confinement_are_refused_whether_or_not_they_are_there(tmp_path):
    (tmp_path / "inside").mkdir()
    wrt.save_image(tmp_path / "red.png", np.full((2, 2, 3), 0.5))
    messages = []
    for image in ("red", "none"):
        light = f'def DomeLight "d" {{\nasset inputs:texture:file = @../{image}.png@\n}}'
        write(tmp_path / "inside", "light.usda", usd(prims=MESH + light))
        path = write(tmp_path / "inside", "a.usda", usd("subLayers = [@light.usda@]"))
        with pytest.raises(wrt.InputError, match=OUTSIDE) as caught:
            wrt.load(path, confined=True)
        messages.append(str(caught.value).replace(f"{image}.png", ""))
    assert messages[0] == messages[1]


def test_clips_are_not_opened(tmp_path):
    """They hold what changes with time; composing opens them nevertheless."""
    for name in ("pipe.usda", "pipe.1.usda"):
        os.mkfifo(tmp_path / name)
    template = 'string templateAssetPath = "./pipe.#.usda"\n'
    template += "\n".join(f"double template{each} = 1" for each in ("StartTime", "EndTime", "Stride"))
    for values in ("asset[] assetPaths = [@./pipe.usda@]", template):
        path = write(tmp_path, "clips.usda", usd(prims=MESH + clips(values)))
        with pytest.warns(InputWarning, match="the metadata clips is unknown to wrt and left out"):
            assert len(load_file(path).shapes) == 1


def test_layers_in_archives_and_in_other_files_are_composed(tmp_path):
    write(tmp_path, "part.usda", usd('defaultPrim = "m"', prims=MESH))
    path = write(tmp_path, "whole.usda", usd(prims='def "a" (references = @part.usda@) {}'))
    with zipfile.ZipFile(tmp_path / "whole.usdz", "w") as archive:
        for name in ("whole.usda", "part.usda"):
            archive.write(tmp_path / name, name)
    outer = write(tmp_path, "outer.usda", usd("subLayers = [@whole.usdz@]"))
    for file in (path, tmp_path / "whole.usdz", outer):
        assert [len(shape.mesh.faces) for shape in load_file(file).shapes] == [1]
        assert len(wrt.load(file, confined=True, frame=False).shapes) >= 1


def test_times_that_are_no_numbers_are_those_of_the_samples(tmp_path):
    points = (
        "point3f[] points.timeSamples = {2: [(0, 0, 0), (1, 0, 0), (0, 1, 0)], 26: [(0, 0, 0), (1, 0, 0), (0, 9, 0)]}"
    )
    prims = "\n".join(points if "points" in line else line for line in MESH.splitlines())
    odd = {"startTimeCode": ("nan", "-inf"), "endTimeCode": ("nan", "inf"), "timeCodesPerSecond": ("nan", "inf", "0")}
    for key, value in ((key, value) for key, values in odd.items() for value in values):
        both = {"startTimeCode": "2", "endTimeCode": "26", "timeCodesPerSecond": "24", key: value}
        lines = [f"{name} = {text}" for name, text in both.items()]
        path = write(tmp_path, f"{key}{value}.usda", usd(*lines, prims=prims))
        begin, end = animation_of(path) or (0.0, 0.0)
        assert begin == 0.0
        assert np.isfinite(end)
        assert len(load_file(path).shapes) == 1


def multiplied(*, instances: bool) -> str:
    """Return a stage of 4 ** 24 prims in a few kB."""
    shared = "instanceable = true" if instances else ""
    stages = [
        f'def "p{i}" {{\n'
        + "".join(f'def "c{j}" (\n{shared}\nreferences = </p{i + 1}>\n) {{}}\n' for j in range(4))
        + "}\n"
        for i in range(24)
    ]
    return usd(prims="".join(stages) + f'def "p24" {{\n{MESH}}}\n')


@pytest.mark.parametrize("instances", [False, True])
def test_references_that_multiply_are_refused(instances, tmp_path, monkeypatch):
    # Fewer instances reach the limit: with their true size it takes 10 s.
    larger = "import wrt.io.usd.prims as prims; prims._BYTES_PER_INSTANCE *= 16; "
    monkeypatch.setattr(process, "_CODE", larger + process._CODE)
    path = write(tmp_path, "multiplied.usda", multiplied(instances=instances))
    check_refused(r"its (USD )?layers and prims would take", load_file, path)


def test_points_of_instances_that_do_not_fit_are_left_out(tmp_path):
    def shapes(values, prototypes="</p/s>"):
        places = "point3f[] positions = [(0, 0, 0), (9, 0, 0), (0, 9, 0)]"
        solid = f'{values}\n{places}\nrel prototypes = [{prototypes}]\ndef Cube "s" {{}}\n'
        return load_file(write(tmp_path, "p.usda", usd(prims=f'{MESH}def PointInstancer "p" {{\n{solid}}}'))).shapes

    with pytest.warns(InputWarning, match="/p: its prototype /p/none is not there; left out"):
        shown = shapes("int[] protoIndices = [0, 0, 0]\nint64[] invisibleIds = [1]", "</p/s>, </p/none>")
    assert [shape.mesh_at(0.0).bounds[1].tolist() for shape in shown[1:]] == [[1, 1, 1], [1, 10, 1]]
    with pytest.warns(InputWarning, match="/p: the numbers of its indices, .* do not agree; left out"):
        assert len(shapes("int[] protoIndices = [0, 0]")) == 1
    with pytest.warns(InputWarning, match="/p: 2 of its instances are of no prototype; left out"):
        assert len(shapes("int[] protoIndices = [0, 5, -1]")) == 2
    assert len(shapes("")) == 1
    with pytest.raises(wrt.InputError, match="/p: its prototype /p has the instancer within it"):
        shapes("int[] protoIndices = [0, 0, 0]", "</p>")


def test_values_that_cannot_be_used_are_named(tmp_path):
    for prims, reason in (
        (MESH.replace("point3f[]", "unknown[]"), "its faces have 3 corners, but 0 are given|names vertex"),
        (MESH.replace("int[] faceVertexC", "string[] faceVertexC").replace("[3]", '["3"]'), "0 corners, but 3"),
        (MESH.replace("[3]", "[9223372036854775807, 3]").replace("int[]", "int64[]"), "corners, but 3 are given"),
        ('def Cube "c" {\nstring size = "x"\n}', "/c: its size must be a number"),
        ('def Cube "c" {\ndouble size = nan\n}', "/c: its size must be finite"),
        (f'{MESH}def SphereLight "l" {{\nfloat inputs:exposure = 1e30\n}}', "/l: .*exposure"),
        (f'{MESH}def Camera "c" {{\nfloat focalLength = 0\n}}', "/c: .*focalLength"),
    ):
        check_refused(reason, load_file, write(tmp_path, "values.usda", usd(prims=prims)))


def test_a_message_of_the_library_has_the_path_once(tmp_path):
    for content, suffix in (
        (b"#usda 1.0\ndef Xform {", "usda"),
        (b"PXR-USDC" + bytes(100), "usdc"),
        (b"garbage", "usd"),
        (b"garbage", "usdc"),
        (b"PK\3\4" + bytes(60), "usdz"),
    ):
        path = write(tmp_path, f"broken.{suffix}", content)
        with pytest.raises(wrt.InputError) as caught:
            load_file(path)
        assert str(caught.value).startswith(f"{path}: "), caught.value
        assert str(caught.value).count(str(tmp_path)) == 1
        assert "\\n" not in str(caught.value)


def test_messages_hold_numbers_and_the_end_of_the_reading_process_is_told(tmp_path, monkeypatch):
    stream, rows = io.BytesIO(), np.arange(6, dtype="<f2").reshape(2, 3)
    process.write_message(stream, {"rows": {process.ARRAY: 0}}, [memoryview(rows)])
    np.testing.assert_array_equal(process.read_message(stream.getvalue())["rows"], rows, strict=True)
    with pytest.raises(ValueError, match="unknown type of numbers 'O'"):
        process.read_message(stream.getvalue().replace(b'"e"', b'"O"'))
    path = write(tmp_path, "box.usda", usd(prims=MESH))
    monkeypatch.setattr(process, "_CODE", "import os; os.abort()")
    check_refused("Pixar's library ended with SIGABRT", load_file, path)
    monkeypatch.setattr(process, "_CODE", "raise ImportError('too little of something')")
    check_refused("Pixar's library cannot be loaded: ImportError: too little of something", load_file, path)
    monkeypatch.setattr(process, "_CODE", "raise KeyError('no such thing')")
    with pytest.raises(RuntimeError, match="no such thing"):  # a fault of wrt
        load_file(path)

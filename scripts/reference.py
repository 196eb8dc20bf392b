"""Write the generated parts of the reference: Python's public names, keys of scene files, options of the command line.

    python scripts/reference.py            rewrite docs/python.md, docs/scene-keys.md and docs/command-line.md
    python scripts/reference.py --check    only report whether they are current

Descriptions come from docstrings, from the JSON schema of scene files, which is made from the classes, and from
argparse. Each generated part stands between two marks in its page.
"""

from __future__ import annotations

import argparse
import inspect
import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.measure import table, write_section

import wrt
from wrt.cli.arguments.options import make_parser
from wrt.describe.docstrings import summary_of
from wrt.io.toml.schema import scene_schema

DOCS = Path(__file__).resolve().parent.parent / "docs"

GROUPS = """
Loading and rendering: load render render_views View Renderer Progress precompile Precompiled device_memory
    DeviceMemory
Several machines: Part merge Merged
Scenes: Scene Shape RenderSettings
Meshes: Mesh load_mesh box sphere spheres disk cylinder quad polygon
Motion: Motion Deformation
Cameras: Camera PerspectiveCamera OrthographicCamera PanoramaCamera FisheyeCamera
Lights: PointLight SpotLight DirectionalLight RectangleLight DiskLight SphereLight ConstantEnvironment
    ImageEnvironment SphericalHarmonicsEnvironment SunSkyEnvironment Light register_light
Materials: Material Diffuse OrenNayar Mirror Glossy Conductor RoughConductor Dielectric RoughDielectric ThinDielectric
    Null Plastic RoughPlastic Principled Burley Measured Measurement Mix TwoSided Emissive Medium DensityGrid
    register_material
Textures: ImageTexture VertexColor NormalMap
Rays: Intersector Hits
Files: load_image save_image develop_image save_scene load_density load_measurement
Errors: InputError
"""
"""The public names by group, in the order in which a reader meets them."""


def groups() -> dict[str, list[str]]:
    """Return the public names by group; names that `GROUPS` does not list come last."""
    found = {}
    for line in GROUPS.strip().replace("\n    ", " ").splitlines():
        title, _, names = line.partition(": ")
        found[title] = [name for name in names.split() if name in wrt.__all__]
    listed = {name for names in found.values() for name in names}
    unlisted = [name for name in wrt.__all__ if name not in listed and not name.startswith("__")]
    return {**found, **({"More": unlisted} if unlisted else {})}


def names_text() -> str:
    """Return tables of all public names with the first sentence of their docstrings, linked to the details."""
    parts = []
    for title, names in groups().items():
        rows = [[f"[`{name}`](#wrt{name.lower()})", first_sentence(summary_of(getattr(wrt, name)))] for name in names]
        parts.append(f"**{title}**\n\n" + table(["name", "what it is"], rows))
    return "\n".join(parts)


def first_sentence(text: str) -> str:
    """Return the first sentence of a text, with bars escaped, which would end a cell of a table."""
    return re.split(r"(?<=[.!])\s(?=[A-Z])", text)[0].replace("|", "\\|")


def details_text() -> str:
    """Return a heading for each name, and the directive by which mkdocstrings shows its docstring."""
    parts = []
    for names in groups().values():
        parts += [f"### wrt.{name}\n\n::: {where(name)}.{name}\n" for name in names]
    return "\n".join(parts)


def where(name: str) -> str:
    """Return the module in which a public name is defined."""
    found = inspect.getmodule(getattr(wrt, name))
    return "wrt" if found is None else found.__name__


def options_text() -> str:
    """Return a table of options for each command."""
    parser = make_parser()
    parts = []
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            summaries = {choice.dest: choice.help or "" for choice in action._choices_actions}
            for name, command in action.choices.items():
                parts.append(f"### wrt {name}\n\n{(command.description or summaries[name]).strip()}\n")
                rows = [row_of(a) for a in command._actions if not isinstance(a, argparse._HelpAction)]
                if rows:
                    parts.append(table(["argument", "meaning"], rows))
    return "\n".join(parts)


def row_of(action: argparse.Action) -> list[str]:
    """Return the row of an argument: its syntax and its help."""
    metavar = action.metavar if isinstance(action.metavar, str) else ""
    if action.choices is not None and not metavar:
        metavar = "{" + ",".join(map(str, action.choices)) + "}"
    written = [f"{option} {metavar}".strip() for option in action.option_strings] or [metavar or action.dest]
    meaning = (action.help or "").replace("%(default)s", str(action.default)).replace("%%", "%").replace("|", "\\|")
    return [", ".join(f"`{text}`" for text in written), meaning]


# --- Scene files -----------------------------------------------------------------------------------

TABLES = {
    "settings": "[settings]",
    "camera": "[camera]",
    "environment": "[environment]",
    "light": "[[lights]]",
    "medium": "[media.NAME]",
    "material": "[materials.NAME]",
    "shape": "[[shapes]]",
}
"""The definitions of the schema that are tables of a scene file, and their syntax."""

PARTS_OF_VALUES = {
    "texture": "Textures",
    "vertex_colors": "Vertex colours",
    "normal_map": "Normal maps",
    "turn": "Turns",
    "keyframe": "Keyframes",
    "motion": "Motions",
    "instance": "Instances",
    "deformation": "Deformations",
    "density": "Densities",
}
"""Definitions that are tables within tables, and their headings."""

WORDS_OF_REFERENCES = {
    "vector": "`[x, y, z]`",
    "texture": "[varies](#values-that-vary)",
    "color_that_varies": "number or `[r, g, b]` or [varies](#values-that-vary)",
}


def keys_text() -> str:
    """Return a table of keys for every kind of table in a scene file."""
    definitions = scene_schema()["definitions"]
    parts = []
    for name, written in TABLES.items():
        kinds = [key.removeprefix(f"{name}-") for key in definitions if key.startswith(f"{name}-")]
        parts.append(f"## `{written}`\n")
        if not kinds:
            parts.append(table_of_keys(definitions[name], set()))
            continue
        properties = [definitions[f"{name}-{kind}"]["properties"] for kind in kinds]
        common = {key for key in properties[0] if all(found.get(key) == properties[0][key] for found in properties)}
        if common:
            first = definitions[f"{name}-{kinds[0]}"]
            parts.append(f"Keys of every type:\n\n{table_of_keys(first, set(properties[0]) - common)}")
        for kind in kinds:
            found = definitions[f"{name}-{kind}"]
            about = found.get("description", "").removeprefix("Return ")
            parts.append(f'### {name} type = "{kind}"\n\n{about[:1].upper()}{about[1:]}\n')
            if set(found["properties"]) - common - {"type"}:
                parts.append(table_of_keys(found, {*common, "type"}))
    parts.append("## Tables within tables\n")
    for name, title in PARTS_OF_VALUES.items():
        parts.append(f"### {title}\n")
        forms = definitions[name].get("anyOf", [definitions[name]])
        parts += [("Or:\n\n" if form is not forms[0] else "") + table_of_keys(form, set()) for form in forms]
    return "\n".join(parts)


def table_of_keys(found: dict[str, Any], left_out: set[str]) -> str:
    """Return a table of the keys of a definition."""
    rows = []
    for key, value in found["properties"].items():
        if key in left_out or (key == "type" and "const" in value):
            continue
        default = "required" if key in found.get("required", ()) else ""
        if "default" in value:
            default = f"`{json.dumps(value['default'])}`"
        rows.append([f"`{key}`", values_in_words(value), default, meaning_of(value)])
    return table(["key", "value", "default", "meaning"], rows)


def meaning_of(value: dict[str, Any]) -> str:
    """Return a key's description, without words that concern only Python."""
    text = value.get("description", "")
    text = re.sub(r",? ?one of [A-Z_]+(, or two, for u and for v)?\.?$", ".", text).lstrip(".") or "one of these."
    text = re.sub(r"one of [A-Z_]+; ", "", text)
    text = text.replace("None is", "left out, it is").replace(". left out", ". Left out")
    return (text[:1].upper() + text[1:]).replace("|", "\\|")


def values_in_words(value: dict[str, Any], *, many: bool = False) -> str:
    """Return the type of a key: numbers with their limits, words, arrays, references to other tables.

    Args:
        value: the schema of the key.
        many: whether to use the plural.
    """
    for several in ("anyOf", "allOf"):
        if several in value:
            return " or ".join(
                dict.fromkeys(values_in_words(option, many=many) for option in options_of(value[several]))
            )
    if "$ref" in value:
        name = value["$ref"].rpartition("/")[2]
        title = PARTS_OF_VALUES.get(name, "")
        return WORDS_OF_REFERENCES.get(name) or f"[{title.lower().removesuffix('s')}](#{anchor(title)})"
    if "enum" in value or "const" in value:
        return ", ".join(f"`{json.dumps(word)}`" for word in value.get("enum", [value.get("const")]))
    if value.get("type") == "array":
        count = value.get("minItems") if value.get("minItems") == value.get("maxItems") else None
        if count == 3 and value["items"].get("type") == "number":
            return "`[r, g, b]`"
        items = values_in_words(value["items"], many=True)
        if "enum" in value["items"]:
            return "two of them" if count == 2 else f"array of {items}"
        return f"{count} {items}" if count else f"array of {items}"
    if value.get("type") == "boolean":
        return "`true` or `false`"
    kind = {"number": "number", "integer": "whole number", "string": "text"}[value["type"]]
    return kind + ("s" if many else "") + limits_in_words(value)


def options_of(several: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return options without the alternatives for textures."""
    references = [option.get("$ref", "").rpartition("/")[2] for option in several]
    if "texture" not in references:
        return several
    return [o for o, name in zip(several, references, strict=True) if name != "vertex_colors" and "const" not in o]


def anchor(title: str) -> str:
    """Return the anchor of a heading."""
    return title.lower().replace(" ", "-")


def limits_in_words(value: dict[str, Any]) -> str:
    """Return the limits of a number, with a comma before them."""
    low, high = value.get("minimum"), value.get("maximum")
    above, below = value.get("exclusiveMinimum"), value.get("exclusiveMaximum")
    texts = []
    if low is not None and high is not None:
        return f" {low:,} to {high:,}"
    texts += [f"from {low:,}"] if low is not None else []
    texts += [f"above {above:,}"] if above is not None else []
    texts += [f"up to {high:,}"] if high is not None else []
    texts += [f"below {below:,}"] if below is not None else []
    return "".join(f" {text}" for text in texts).replace("above 0 below", "above 0 and below")


PARTS = {
    "python.md": {"names": names_text, "details": details_text},
    "scene-keys.md": {"keys": keys_text},
    "command-line.md": {"options": options_text},
}
"""The pages, and what is written between which marks."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the status is 1 if `--check` finds a page that is not current."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--check", action="store_true", help="write nothing; end with status 1 if a page is not current"
    )
    options = parser.parse_args(arguments)
    stale = []
    for name, parts in PARTS.items():
        page = DOCS / name
        before = page.read_text(encoding="utf-8")
        for mark, text in parts.items():
            write_section(page, mark, text())
        if page.read_text(encoding="utf-8") != before:
            stale.append(name)
            if options.check:
                page.write_text(before, encoding="utf-8")
    print("\n".join(f"docs/{name}: {'not current' if options.check else 'written'}" for name in stale) or "all current")
    return 1 if options.check and stale else 0


if __name__ == "__main__":
    sys.exit(main())

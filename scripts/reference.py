"""Write the generated parts of the reference: Python's public names, keys of scene files, options of the command line.

    python scripts/reference.py            rewrite the generated pages and the schema of docs
    python scripts/reference.py --check    only report whether they are current

Descriptions come from docstrings, from the JSON schema of scene files, which is made from the classes, and from
argparse. Each generated part stands between two marks in its page.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import inspect
import json
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.measure import write_section

import wrt
from wrt.cli.arguments.options import make_parser
from wrt.cli.arguments.parser import commands_of
from wrt.describe.docstrings import meanings_of, plain, summary_of
from wrt.io.toml.reader import shape_makers
from wrt.io.toml.schema import scene_schema, schema_text
from wrt.scene.camera import CAMERAS
from wrt.scene.environment import ENVIRONMENTS
from wrt.scene.lights import LIGHTS
from wrt.scene.materials import MATERIALS

DOCS = Path(__file__).resolve().parent.parent / "docs"

# --- Python ----------------------------------------------------------------------------------------


def _names(classes: Mapping[str, type]) -> str:
    return " ".join(cls.__name__ for cls in classes.values())


GROUPS: dict[str, str] = {
    "Loading and rendering": "load render render_views View Renderer Progress parameters precompile Precompiled "
    "device_memory DeviceMemory",
    "Several machines": "Part merge Merged",
    "Scenes": "Scene Shape RenderSettings",
    "Meshes": "Mesh load_mesh box sphere spheres disk cylinder quad polygon DistanceShape register_shape",
    "Motion": "Motion Deformation",
    "Cameras": f"Camera {_names(CAMERAS)} load_cameras save_cameras FileCamera register_camera",
    "Lights": f"{_names(LIGHTS)} {_names(ENVIRONMENTS)} Light register_light",
    "Materials": f"Material {_names(MATERIALS)} Measurement register_material check_bsdf load_models",
    "Integrators": "Integrator register_integrator",
    "Media": "Medium DensityGrid",
    "Textures": "ImageTexture VertexColor NormalMap Texture Checkerboard Bricks PerlinNoise WorleyNoise "
    "register_texture",
    "Rays": "Intersector Hits",
    "Files and pictures": "load_image save_image cryptomatte_mask develop_image show save_video turntable save_scene "
    "load_density load_measurement",
    "Errors": "InputError InputWarning",
}
"""The public names by subject, in the order in which a reader meets them."""

INTERNAL_MEMBERS = {
    *(
        "arguments_for",
        "denoising_guides",
        "check",
        "greatest",
        "half_angles",
        "has_updated_vertices",
        "is_isotropic",
        "is_rigid",
        "keys_of",
    ),
    *("moves", "needs_tangents", "outline", "parts", "reduction", "renders_light", "require_fit", "require_own_tone"),
    *("restore", "share", "shines", "table_key", "taking", "with_backend"),
    *dir(tuple),
}
"""Members without an underscore that only wrt itself calls, or that a named tuple has."""


BASES_OF_SCENE_FILES = {
    wrt.Camera: "scene-format.md#camera",
    wrt.Material: "scene-format.md#materialsname",
}
"""Classes whose members this page explains, and the places of their fields."""


def names_text() -> str:
    """Return signature, summary, arguments and errors of every public name, and the members of classes."""
    parts = []
    explained: dict[tuple[str, str], str] = {}
    for title, listed in GROUPS.items():
        parts += [f"## {title}\n", *(entry_of(name, explained) for name in listed.split())]
    return "\n".join(parts)


def entry_of(name: str, explained: dict[tuple[str, str], str]) -> str:
    """Return the entry of a public name. Classes of scene files are explained on the page of these.

    Args:
        name: the public name.
        explained: the name under which each row, a key and its meaning, was listed first; new ones are added.
    """
    thing = getattr(wrt, name)
    heading = f"### wrt.{name}\n\n`wrt.{name}{signature_of(thing)}`"
    if place := scene_file_section(thing):
        short = re.sub(r"[*], .*[)]`$", "*, ...)`", heading)
        made = {
            use: text
            for use, text in members_of(thing).items()
            if use.startswith("`from_") and use[1:].partition("(")[0] in vars(thing)
        }
        if thing is wrt.Medium:  # a type of scene files explains the arguments of each
            made = {use: text.partition(" `")[0] for use, text in made.items()}
        meaning = "its fields" if inspect.isclass(thing) else "its arguments"
        return f"{short}: [{meaning}]({place}).\n" + (f"\nMembers:\n\n{listing(made)}" if made else "")
    parts = [f"{heading}\n\n{summary_of(thing)}\n"]
    is_class = inspect.isclass(thing)
    for kind, documented in {"Arguments": getattr(thing, "__init__", None), "Fields": thing}.items():
        if place := BASES_OF_SCENE_FILES.get(thing) if documented is thing else None:
            parts.append(f"[Its fields]({place}).\n")
        elif documented and (meanings := meanings_of(documented)):
            title = f"{kind}:\n\n" if is_class else ""
            parts.append(title + rows_of(name, {f"`{key}`": meaning for key, meaning in meanings.items()}, explained))
    parts += [f"{title}: {text}\n" for title, text in results_of(thing).items()]
    if is_class and not issubclass(thing, Exception) and (members := members_of(thing)):
        parts.append("Members:\n\n" + rows_of(name, members, explained))
    return "\n".join(parts)


def rows_of(name: str, meanings: dict[str, str], explained: dict[tuple[str, str], str]) -> str:
    """Return a list of names and their meanings; longer ones that an earlier entry has word for word, by name alone."""
    likewise: dict[str, list[str]] = {}
    for row in meanings.items():
        if row[1] in (f"the {row[0]}.".replace("`", ""), f"the {row[0]}".replace("`", "")):
            continue  # nothing that its name does not say
        place = name if row[1].count(" ") < 3 else explained.setdefault(row, name)
        likewise.setdefault(place, []).append(row[0])
    own = {key: meanings[key] for key in likewise.pop(name, [])}
    same = "".join(f"- as for `wrt.{other}`: {', '.join(keys)}\n" for other, keys in likewise.items())
    return listing(own) + same


def signature_of(thing: Callable[..., Any]) -> str:
    """Return the signature without annotations, which the meanings of the arguments explain; none for exceptions."""
    if inspect.isclass(thing) and issubclass(thing, BaseException):
        return ""
    signature = inspect.signature(thing)
    parameters = []
    for parameter in signature.parameters.values():
        default = parameter.default
        if default is not inspect.Parameter.empty and not isinstance(default, (bool, int, float, str, tuple)):
            default = None  # made anew for each object
        if parameter.name != "self":
            parameters.append(parameter.replace(annotation=inspect.Parameter.empty, default=default))
    return str(inspect.Signature(parameters))


def scene_file_section(thing: Any) -> str:
    """Return the place where scene-format.md explains a class's fields, or nothing."""
    for base, anchor in {
        wrt.Camera: "camera",
        wrt.Material: "materialsname",
        wrt.Light: "lights",
        wrt.RenderSettings: "settings",
        wrt.ImageTexture: "textures",
        wrt.VertexColor: "values-that-vary",
        wrt.NormalMap: "normal-maps",
        wrt.Medium: "medianame",
        (wrt.ConstantEnvironment, wrt.SphericalHarmonicsEnvironment, wrt.SunSkyEnvironment): "environment",
    }.items():
        if inspect.isclass(thing) and issubclass(thing, base) and thing not in (wrt.Camera, wrt.Material, wrt.Light):
            return f"scene-format.md#{anchor}"
    return "scene-format.md#shapes" if thing in shape_makers().values() else ""


def results_of(thing: Any) -> dict[str, str]:
    """Return what a docstring says of results; all functions raise InputError for what cannot be used."""
    text = inspect.getdoc(thing) or ""
    found = {}
    for title in ("Returns", "Yields"):
        if section := re.search(rf"^{title}:\n((?: +.*\n?|\n(?= ))+)", text, re.MULTILINE):
            found[title] = plain(section[1])
    return found


def members_of(cls: type[Any]) -> dict[str, str]:
    """Return the meaning of each public method and property of a class that is no field."""
    fields = {field.name for field in dataclasses.fields(cls)} if dataclasses.is_dataclass(cls) else set()
    members = {}
    for name, member in inspect.getmembers(cls):
        is_data = isinstance(member, (property, functools.cached_property))
        if name.startswith("_") or name in fields | INTERNAL_MEMBERS or not (is_data or inspect.isroutine(member)):
            continue
        meanings = {} if is_data else meanings_of(member)
        summary = re.sub("^Return (.)", lambda found: found[1].upper(), summary_of(member))
        text = " ".join([summary, *(f"`{key}`: {meaning}" for key, meaning in meanings.items())])
        text += "".join(f" {title} {found}" for title, found in results_of(member).items())
        members[f"`{name}{'' if is_data else signature_of(member)}`"] = text
    return members


def listing(meanings: Mapping[str, str]) -> str:
    """Return a list of names and their meanings."""
    return "".join(f"- {name}: {meaning}\n" for name, meaning in meanings.items())


# --- The command line ------------------------------------------------------------------------------


def options_text() -> str:
    """Return a list of options for each command; those of `wrt render` are explained there alone."""
    commands = commands_of(make_parser())
    options = {
        name: dict(syntax_and_help(a) for a in command._actions if not isinstance(a, argparse._HelpAction))
        for name, command in commands.items()
    }
    parts = []
    for name, command in commands.items():
        parts.append(f"### wrt {name}\n\n{(command.description or '').strip()}\n")
        same = [key for key, text in options[name].items() if name != "render" and options["render"].get(key) == text]
        explained = {key: text for key, text in options[name].items() if key not in same}
        if explained:
            parts.append(listing(explained))
        if same:
            names = (f"`{re.findall('-+[a-z-]+', key)[0]}`" for key in same)
            parts.append(f"As for render: {', '.join(names)}.\n")
    return "\n".join(parts)


def syntax_and_help(action: argparse.Action) -> tuple[str, str]:
    """Return the syntax of an argument and its help."""
    metavar = action.metavar if isinstance(action.metavar, str) else ""
    if action.choices is not None and not metavar:
        metavar = "{" + ",".join(map(str, action.choices)) + "}"
    written = [f"{option} {metavar}".strip() for option in action.option_strings] or [metavar or action.dest]
    meaning = (action.help or "").replace("%(default)s", str(action.default)).replace("%%", "%")
    return ", ".join(f"`{text}`" for text in written), meaning


# --- Scene files -----------------------------------------------------------------------------------

TABLES_WITHIN_TABLES = {
    "textures": ("texture", "textures"),
    "vertex-colors": ("vertex_colors", "values-that-vary"),
    "normal-maps": ("normal_map", "normal-maps"),
    "turns": ("turn", "motion-instances-deformation"),
    "keyframes": ("keyframe", "motion-instances-deformation"),
    "motions": ("motion", "motion-instances-deformation"),
    "instances": ("instance", "motion-instances-deformation"),
    "deformations": ("deformation", "motion-instances-deformation"),
    "densities": ("density", "density"),
}
"""Marks in the page, the definitions of the schema that stand there, and the headings above them."""

LINKS = {name: f"[{name.replace('_', ' ')}](#{anchor})" for name, anchor in TABLES_WITHIN_TABLES.values()}


def keys_text(name: str) -> str:
    """Return lists of the keys of a definition of the schema; each key of several types is explained once."""
    definitions = scene_schema()["definitions"]
    kinds = [key.removeprefix(f"{name}-") for key in definitions if key.startswith(f"{name}-")]
    if not kinds:
        return "\nor\n\n".join(
            list_of_keys(keys_of(form)) for form in definitions[name].get("anyOf", [definitions[name]])
        )
    all_keys = {kind: keys_of(definitions[f"{name}-{kind}"]) for kind in kinds}
    first = all_keys[kinds[0]]
    for keys in all_keys.values():
        for key, row in keys.items():  # of media, which methods of Medium make
            row[2] = (
                first[key][2] if row[2] == "As the attribute." else row[2].replace("the attribute", f"for `{kinds[0]}`")
            )
    common = {key: row for key, row in first.items() if all(keys.get(key) == row for keys in all_keys.values())}
    parts = [f"Keys of every type:\n\n{list_of_keys(common)}"] if common else []
    explained: dict[tuple[str, ...], str] = {}
    for kind, keys in all_keys.items():
        about = definitions[f"{name}-{kind}"].get("description", "").removeprefix("Return ")
        parts.append(f'### type = "{kind}"\n\n{about[:1].upper()}{about[1:]}\n')
        likewise: dict[str, list[str]] = {}
        shown = {}
        for key, row in keys.items():
            if key in common:
                continue
            place = explained.setdefault((key, *row), kind)
            if place == kind:
                shown[key] = row
            else:
                likewise.setdefault(place, []).append(f"`{key}`")
        if shown:
            parts.append(list_of_keys(shown))
        if likewise:
            listed = "; ".join(f"for `{type_name}`: {', '.join(names)}" for type_name, names in likewise.items())
            parts.append(f"As {listed}.\n")
    return "\n".join(parts)


def keys_of(found: dict[str, Any]) -> dict[str, list[str]]:
    """Return value, default and meaning of each key of a definition but its `type`."""
    rows = {}
    for key, value in found["properties"].items():
        if not (key == "type" and ("const" in value or value.get("description") == "What it is.")):
            default = "required" if key in found.get("required", ()) else ""
            if "default" in value:
                default = f"`{json.dumps(value['default'])}`"
            kind = values_in_words(value)
            rows[key] = [kind, default, meaning_of(value, kind)]
    return rows


def list_of_keys(keys: dict[str, list[str]]) -> str:
    """Return a list of keys, each with its value, default and meaning."""
    meanings = {}
    for key, (kind, default, meaning) in keys.items():
        if default in ("", "required"):
            meanings[f"`{key}` ({kind}{default and '; required'})"] = meaning
        else:
            meanings[f"`{key}={default.strip('`')}` ({kind})"] = meaning
    return listing(meanings)


def meaning_of(value: dict[str, Any], kind: str) -> str:
    """Return a key's description, without words that concern only Python, and without limits that `kind` has."""
    text = value.get("description", "")
    text = re.sub(r",? ?one of [A-Z_]+(, or two, for u and for v)?\.?$", ".", text).lstrip(".") or "one of these."
    text = re.sub(r"one of [A-Z_]+; ", "", text)
    text = re.sub(r"\bNone (is|for)\b", "by default", text)
    text = text.replace(" (wrt materials --presets)", "")  # the page says it once
    text = re.sub(",? per channel", "", text) if kind.startswith("colour") else text
    if limits := re.search(r"(?:above )?(\S+) (?:up )?to ([\d.]+)", kind.replace(",", "")):  # "0 to 1" in the text, too
        low, high = re.escape(limits[1]), re.escape(limits[2])
        text = re.sub(rf",? (?:above )?{low} (?:to|and at most) {high}\b,?", "", text)
    return text[:1].upper() + text[1:]


def values_in_words(value: dict[str, Any], *, plural: bool = False) -> str:
    """Return the type of a key: numbers with their limits, words, arrays, references to other tables.

    Args:
        value: the schema of the key.
        plural: whether to use the plural.
    """
    options = value.get("anyOf", value.get("allOf"))
    if options:
        references = {option["$ref"].rpartition("/")[2] for option in options if "$ref" in option}
        if "texture" in references and len(options) > 1:
            literal = [o for o in options if "const" not in o and "$ref" not in o]
            return ", ".join([*([values_in_words({"anyOf": literal})] if literal else []), "varies"])
        if [option.get("type") for option in options[:2]] == ["number", "array"] and options[1].get("minItems") == 3:
            rest = [option for option in options[2:] if option.get("type") != "string"]  # names of colours are colours
            return " or ".join(["colour" + limits_in_words(options[0]), *map(values_in_words, rest)])
        if "enum" in options[0].get("items", {}):
            return values_in_words(options[0])  # also one of them, or a text of several
        return " or ".join(dict.fromkeys(values_in_words(option, plural=plural) for option in options))
    if "$ref" in value:
        name = value["$ref"].rpartition("/")[2]
        return {"vector": "vector", "color_that_varies": "colour, varies"}.get(name) or LINKS[name]
    if "enum" in value or "const" in value:
        return ", ".join(f"`{json.dumps(word)}`" for word in value.get("enum", [value.get("const")]))
    if value.get("type") == "array":
        count = value.get("minItems") if value.get("minItems") == value.get("maxItems") else None
        items = values_in_words(value["items"], plural=True)
        if "enum" in value["items"]:
            return "two of them" if count == 2 else f"array of {items}"
        return f"{count} {items}" if count else f"array of {items}"
    kind = {"number": "number", "integer": "integer", "string": "text", "boolean": "boolean", "object": "table"}[
        value["type"]
    ]
    return kind + ("s" if plural else "") + limits_in_words(value)


def limits_in_words(value: dict[str, Any]) -> str:
    """Return the limits of a number."""
    low, high = value.get("minimum"), value.get("maximum")
    above, below = value.get("exclusiveMinimum"), value.get("exclusiveMaximum")
    if low is not None and high is not None:
        return f" {low:,} to {high:,}"
    texts = [f"≥ {low:,}"] if low is not None else []
    texts += [f"above {above:,}"] if above is not None else []
    texts += [f"up to {high:,}"] if high is not None else []
    texts += [f"below {below:,}"] if below is not None else []
    return "".join(f" {text}" for text in texts).replace("above 0 below", "above 0 and below")


# --- Pages -----------------------------------------------------------------------------------------

SECTIONS = ("settings", "camera", "environment", "light", "medium", "material", "shape")
"""The definitions of the schema that are tables of a scene file, and the marks in the page."""

PARTS: dict[str, dict[str, Callable[[], str]]] = {
    "python.md": {"names": names_text},
    "scene-format.md": {
        **{name: functools.partial(keys_text, name) for name in SECTIONS},
        **{mark: functools.partial(keys_text, name) for mark, (name, _) in TABLES_WITHIN_TABLES.items()},
    },
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
    schema = DOCS / "scene.schema.json"
    if schema.read_text(encoding="utf-8") != schema_text():
        stale.append(schema.name)
        if not options.check:
            schema.write_text(schema_text(), encoding="utf-8")
    print("\n".join(f"docs/{name}: {'not current' if options.check else 'written'}" for name in stale) or "all current")
    return 1 if options.check and stale else 0


if __name__ == "__main__":
    sys.exit(main())

"""argparse with one-line errors and spelling hints, and with inputs anywhere among the options."""

from __future__ import annotations

import argparse
import os
import shlex
from collections.abc import Sequence
from typing import Any, NoReturn

from wrt.errors import InputError, did_you_mean

_ELSEWHERE = {
    "--samples": "--spp",
    "--width": "--size",
    "--height": "--size",
    "--resolution": "--size",
    "--gpu": "--device",
    "--cuda": "--device",
    "--camera": "--view",
    "--format": "--output",
}
"""Options of other renderers, and what they are here."""


class Parser(argparse.ArgumentParser):
    """argparse that raises InputError instead of exiting."""

    def error(self, message: str) -> NoReturn:
        """Raise InputError."""
        raise InputError(message if message.endswith("?)") else f"{message} (see '{self.prog} --help')")


class Once(argparse.Action):
    """Stores an option's value and refuses a second one, where argparse would silently drop the first."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        """Store the value."""
        if (first := getattr(namespace, self.dest)) is not None:
            raise argparse.ArgumentError(self, f"given twice, as {first!r} and as {values!r}")
        setattr(namespace, self.dest, values)


def parse_with(parser: argparse.ArgumentParser, arguments: list[str]) -> argparse.Namespace:
    """Parse arguments with a parser that has commands.

    Raises:
        InputError: if the arguments are wrong.
        SystemExit: after --help and --version.
    """
    commands = commands_of(parser)
    word = arguments[0] if arguments else None
    if word is None or word in parser._option_string_actions:
        return parser.parse_args(arguments)
    if word not in commands:
        raise InputError(_no_command(word, arguments[1:], commands))
    command = commands[word]
    try:
        options, unparsed = command.parse_known_args(arguments[1:])
    except InputError:
        _refuse_files(_split(arguments[1:])[1], command)  # without which a name is missing
        raise
    _add_inputs(command, options, unparsed)
    return options


def commands_of(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Return the parsers of the commands by name."""
    (action,) = (each for each in parser._actions if isinstance(each, argparse._SubParsersAction))
    return dict(action.choices)


def _add_inputs(command: argparse.ArgumentParser, options: argparse.Namespace, unparsed: list[str]) -> None:
    """Add the arguments that argparse left over to the inputs, or raise InputError."""
    names, dashes, literal = _split(unparsed)
    _refuse_files(dashes, command)
    for word in dashes:
        valid = list(command._option_string_actions)
        option = word.partition("=")[0]
        if (meant := _ELSEWHERE.get(option)) in valid:
            raise InputError(f"there is no option {option} (did you mean {meant!r}?)")
        hint = did_you_mean(option.lower(), valid) or f" (see '{command.prog} --help')"
        raise InputError(f"there is no option {option}{hint}")
    inputs = names + literal
    if inputs and not hasattr(options, "inputs"):
        raise InputError(f"unexpected argument {inputs[0]!r} (see '{command.prog} --help')")
    if inputs:
        options.inputs += inputs


def _refuse_files(words: list[str], command: argparse.ArgumentParser) -> None:
    """Raise InputError if one of some words that look like options is the name of a file."""
    for word in words:
        if word not in command._option_string_actions and os.path.lexists(word):
            raise InputError(f"{word!r} begins like an option; to name the file, type ./{word}")


def _split(arguments: list[str]) -> tuple[list[str], list[str], list[str]]:
    """Split arguments into names, words that look like options, and everything after "--"."""
    end = arguments.index("--") if "--" in arguments else len(arguments)
    dashes = [word for word in arguments[:end] if word.startswith("-") and word != "-"]
    return [word for word in arguments[:end] if word not in dashes], dashes, arguments[end + 1 :]


def _no_command(word: str, arguments: list[str], commands: dict[str, argparse.ArgumentParser]) -> str:
    """Return the error message for a first word that is not a command, followed by `arguments`."""
    from wrt.meshes import scene_names

    if word.startswith("-"):
        option = word.partition("=")[0]
        having = [name for name, command in commands.items() if option in command._option_string_actions]
        if having:
            return f"{option} goes after a command, such as: wrt {having[-1]} ... {shlex.join([word, *arguments][:2])}"
        return f"there is no option {option} (see 'wrt --help')"
    if word in scene_names() or os.path.lexists(word) or os.path.splitext(word)[1]:
        return f"{word!r} is not a command; to render it, type: wrt {shlex.join(['render', word, *arguments])}"
    scenes = {name: f"render {name}" for name in scene_names()}
    hint = did_you_mean(word.lower(), [*commands, *scenes])
    for name, typed in scenes.items():
        hint = hint.replace(repr(name), repr(typed))
    return f"there is no command {word!r}{hint or '; there are ' + ', '.join(commands)}"

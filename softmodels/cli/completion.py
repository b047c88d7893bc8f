"""What a shell needs to complete commands: all their words, in one script, so that Tab starts no Python."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import click

from geometries import ACTUATORS
from softmodels.case import case, entries, load, materials
from softmodels.cli import options
from softmodels.common import schema
from softmodels.materials import silicones
from softmodels.mechanics import component

BASH = """# softmodels: completion for bash; zsh reads it too
_softmodels() {{
    local current="${{COMP_WORDS[COMP_CWORD]}}" before="${{COMP_WORDS[COMP_CWORD-1]}}" known
    case "$before" in
{values}
    *)  case "${{COMP_WORDS[1]}} ${{COMP_WORDS[2]}}" in
{commands}
        *) known="{top}" ;;
        esac ;;
    esac
    COMPREPLY=($(compgen -W "$known" -- "$current"))
    if [[ $before == --set ]]; then compopt -o nospace 2>/dev/null || true; fi
}}
complete -o default -F _softmodels softmodels
"""
ZSH = "autoload -U +X compinit bashcompinit && compinit && bashcompinit\n"
FISH = """# softmodels: completion for fish
function __softmodels_words
    set -l words (commandline -opc) x x
    switch (commandline -opc)[-1]
{values}
        case '*'
            switch "$words[2] $words[3]"
{commands}
                case '*'
                    string split -- ' ' '{top}'
            end
    end
end
complete -c softmodels -a '(__softmodels_words)'
"""
SHELLS = ("bash", "zsh", "fish")


@options.command("completion")
@click.argument("shell", type=click.Choice(SHELLS))
def completion_command(shell: str) -> None:
    """Print what a shell needs to complete commands.

    With it Tab completes commands, options, devices, silicones, and fields after --set; all else are names of files. Write it
    again after an update.

    \b
    Examples:
      softmodels completion bash > ~/.local/share/bash-completion/completions/softmodels
      softmodels completion zsh > ~/.softmodels.zsh       (and in ~/.zshrc: source ~/.softmodels.zsh)
      softmodels completion fish > ~/.config/fish/completions/softmodels.fish
    """
    program = click.get_current_context().find_root().command
    assert isinstance(program, click.Group)
    click.echo(script(shell, program))


def script(shell: str, program: click.Group) -> str:
    """Return the script for a shell."""
    commands = dict(commands_of(program))
    values = {
        options.DEVICE: list(ACTUATORS),
        "--material": [*options.LAWS, *silicones.PRODUCTS],
        "--silicone": list(silicones.PRODUCTS),
        "--band": list(silicones.PRODUCTS),
        "--set": [f"{name}=" for name in field_names()],
    }
    text, indent = (FISH, " " * 8) if shell == "fish" else (BASH, " " * 4)
    made = text.format(
        values="\n".join(_case(shell, [name], words, indent) for name, words in values.items()),
        commands="\n".join(_case(shell, name.split(), words, 2 * indent) for name, words in commands.items() if name),
        top=" ".join(commands[""]),
    )
    return (ZSH if shell == "zsh" else "") + made


def _case(shell: str, name: list[str], words: list[str], indent: str) -> str:
    """Return the branch of a shell's switch for a command of one or two words, or for an option."""
    star = len(name) == 1 and not name[0].startswith("-")
    pattern = f"'{' '.join(name)}{' *' if star else ''}'"
    if shell == "fish":
        return f"{indent}case {pattern}\n{indent}    string split -- ' ' '{' '.join(words)}'"
    if star:
        pattern = f"{name[0]}' '*"
    return f'{indent}{pattern}) known="{" ".join(words)}" ;;'


def commands_of(group: click.Group, name: str = "") -> Iterator[tuple[str, list[str]]]:
    """Yield the words that may follow the program's name and each of its commands, groups behind their commands."""
    context, own = click.Context(group), list[str]()
    for inner in group.list_commands(context):
        command, path = group.get_command(context, inner), f"{name} {inner}".strip()
        own.append(inner)
        if isinstance(command, click.Group):
            yield from commands_of(command, path)
        elif command is not None:
            yield path, _options(command)
    yield name, [*own, *_options(group)]


def _options(command: click.Command) -> list[str]:
    params = [*command.get_params(click.Context(command)), *getattr(command, "device_params", list)()]
    words = [
        word
        for param in params
        if isinstance(param, click.Argument) and isinstance(param.type, click.Choice)
        for word in param.type.choices
    ]
    return list(dict.fromkeys([*words, *(option for param in params for option in param.opts if option[:2] == "--")]))


def field_names() -> list[str]:
    """Return the names of the fields of a case file for ``--set``, but those of tables that have a name."""
    names = ["name", *(f"load.{key}" for key in (*load.request_keys(), "rate", "hold", "cycles"))]
    values = [entry for entry in case.entries().values() if isinstance(entry, entries.Value)]
    names += [f"{entry.table}.{entry.key}" for entry in values]
    names += ["material.law", *(f"material.{name}" for name in materials.material_options_of())]
    kinds: list[tuple[str, Mapping[str, object]]] = [("geometry", schema.about(kind)) for kind in ACTUATORS.values()]
    parts = component.COMPONENTS.values()
    kinds += [(kind.table, schema.about(kind)) for kind in parts if not kind.always_named]
    return list(dict.fromkeys([*names, *(f"{table}.{name}" for table, fields in kinds for name in fields)]))

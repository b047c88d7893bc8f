"""How commands start, where their results go, and how they end: by themselves, stopped, or with a closed pipe."""

from __future__ import annotations

import atexit
import contextlib
import dataclasses
import datetime
import errno
import functools
import gc
import importlib
import os
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import click

from softmodels.common import errors, folders, processes
from softmodels.common.files import fingerprint, is_same, version
from softmodels.common.folders import InUseError, OwnFolderError

# ----------------------------------------------------------------------------------------------------------------------
# End commands cleanly when stopped or if the output fails: one sentence and a status, no traceback.


EXIT_DONE, EXIT_FAILED, EXIT_BAD_INPUT, EXIT_NO_EQUILIBRIUM, EXIT_STOPPED = 0, 1, 2, 3, 130
STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)
BLOCKED = (
    f"softmodels: stopped by the user; the step under way had not ended {processes.GRACE_SECONDS} s after the signal, "
    "earlier ones are kept"
)
LONGEST_SENTENCE = 1000
"""Characters of a sentence on standard error; a user's own text in it may be a whole file's content."""


def bounded(sentence: str) -> str:
    """Return a sentence of at most `LONGEST_SENTENCE` characters: of a longer one the beginning and the end, with dots
    between."""
    if len(sentence) <= LONGEST_SENTENCE:
        return sentence
    half = (LONGEST_SENTENCE - 5) // 2
    return f"{sentence[:half]} ... {sentence[-half:]}"


@contextlib.contextmanager
def unswept() -> Iterator[None]:
    """Keep the collector of reference cycles away from all there is by the end of this, for imports and for a process that
    only draws: looking through them again and again takes a fifth of a short command's time. A process that goes on afterwards
    has `gc.unfreeze`."""
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
        atexit.unregister(gc.freeze)
        atexit.register(gc.freeze)  # what a process leaves behind goes with it


# ----------------------------------------------------------------------------------------------------------------------
# Options of a command as the fields of a dataclass: each stands once, with its type, its default and its help.


def option(*flags: str, argument: bool = False, **how: Any) -> Any:
    """Return a field of a dataclass of options (or an argument, without a name); its option is ``--`` and the field's name
    unless flags such as ``"-o", "--output"`` are given. The rest is what `click.option` takes."""
    empty = False if how.get("is_flag") else () if how.get("multiple") or argument else None
    return dataclasses.field(default=how.get("default", empty), metadata={"option": (flags, argument, how)})


def options[C: Callable[..., object]](kind: type, name: str = "how") -> Callable[[C], C]:
    """Add the fields of a dataclass as options to a command's function, which gets a value of it as an argument."""

    def add(function: Any) -> Any:
        fields = dataclasses.fields(kind)

        @functools.wraps(function)
        def command(*args: object, **values: Any) -> object:
            given = {field.name: values.pop(field.name) for field in fields}
            return function(*args, **{name: kind(**given)}, **values)

        for field in reversed(fields):  # click lists the option added last first
            flags, argument, how = field.metadata["option"]
            if argument:
                command = click.argument(field.name, **how)(command)
            else:
                command = click.option(*(flags or [f"--{field.name.replace('_', '-')}"]), field.name, **how)(command)
        return command

    return add


def flag_option(text: str) -> Any:
    """Return the field of an option without a value."""
    return option(is_flag=True, help=text)


def quiet_option() -> Any:
    return flag_option("Print only errors.")


def output_option(text: str) -> Any:
    """Return the field of ``--output``, the folder for results."""
    return option("-o", "--output", type=FolderType(), help=text)


class ColormapType(click.ParamType):
    """A colour map by its name in matplotlib; ``:linear`` or ``:bands`` make it a linear scale, or ten bands of it."""

    name = "NAME"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        if value != COLORMAP:
            import matplotlib

            name, _, kind = str(value).partition(":")
            if kind not in ("", "linear", "bands"):
                self.fail(f"{value!r} ends in {kind!r}; a colour map may end in ':linear' or ':bands'", param, ctx)
            if name not in matplotlib.colormaps:
                near = errors.meant(name, matplotlib.colormaps)
                self.fail(f"matplotlib has no colour map {name!r}{near or f'; {COLORMAP} is the default'}", param, ctx)
        return str(value)


class Choice(click.Choice[str]):
    """One of some names; a sentence names the nearest one."""

    def get_invalid_choice_message(self, value: Any, ctx: click.Context | None) -> str:
        return super().get_invalid_choice_message(value, ctx).rstrip(".") + errors.meant(value, self.choices)


class FolderType(click.Path):
    """Type of a folder's name; an empty one, such as from an unset variable, is an error."""

    name = "folder"

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if not str(value).strip():
            self.fail("the name of the folder is empty", param, ctx)
        return super().convert(value, param, ctx)


class RanksType(click.ParamType):
    """``auto`` or a number of ranks."""

    name = "auto|N"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> int | None:
        if value is None or value == AUTO:
            return None
        try:
            ranks = int(str(value))
        except ValueError:
            ranks = 0
        if ranks < 1:
            self.fail(f"{value!r} is neither {AUTO} nor a number of ranks, 1 or more", param, ctx)
        return ranks


AUTO = "auto"
COLORMAP = "viridis"
"""Colour map of fields in pictures, unless another one is asked for."""
COLORMAP_OPTION: dict[str, Any] = {
    "type": ColormapType(), "default": COLORMAP, "show_default": True,
    "help": "Colour map of stress and stretch, by matplotlib's name, such as cividis; with :linear or :bands a linear scale.",
}  # fmt: skip


def _pictures(*choices: str) -> Any:
    text = "Pictures and report; few: only the curves, the stress and the report."
    return option(type=Choice(choices), default="all", show_default=True, help=text)


@dataclasses.dataclass(frozen=True)
class DrawingOptions:
    """What is drawn of a run: all pictures, few (only the curves, the stress and the report) or none, the film, and the colour
    map of fields, by matplotlib's name."""

    pictures: str = _pictures("all", "few")
    film: bool = flag_option("Also the film: film.gif and film.webp.")
    colormap: str = option(**COLORMAP_OPTION)

    @property
    def few(self) -> bool:
        return self.pictures == "few"


@dataclasses.dataclass(frozen=True)
class SolvingOptions:
    """How a run is solved; ``output`` and ``ranks`` are None where they are chosen, ``petsc`` are words for PETSc's options."""

    output: Path | None = output_option(  # noqa: RUF009
        "Folder for the results: new, empty, or of an earlier run, whose files are replaced.  [default: results/NAME; "
        "results/NAME-2 and so on if that holds another case]"
    )
    resume: bool = flag_option("Resume an interrupted run.")
    quiet: bool = quiet_option()
    branch: bool = flag_option("Also follow the branch at the first bifurcation; its results go to the folder branch.")
    ranks: int | None = option(
        type=RanksType(), default=AUTO, show_default=True,
        help="Processes to solve on; auto: a core for each 30,000 unknowns of a solid, as far as there are cores.",
    )  # fmt: skip
    petsc: tuple[str, ...] = option(argument=True, nargs=-1, type=click.UNPROCESSED)


@dataclasses.dataclass(frozen=True)
class RunOptions(DrawingOptions, SolvingOptions):
    """The options of a run, none of which changes a number."""

    pictures: str = _pictures("all", "few", "none")
    budget: str = option(
        type=Choice(("auto", "none")), default="auto", show_default=True,
        help="Mesh error of the main numbers; auto: of devices with an axisymmetric section, from that section with cells half "
        "as large, if that costs less than half of the run.",
    )  # fmt: skip
    no_pictures: bool = flag_option("The same as --pictures none.")

    @property
    def draws(self) -> bool:
        return self.pictures != "none" and not self.no_pictures


# ----------------------------------------------------------------------------------------------------------------------
# How a command starts, is stopped, and ends.


@contextlib.contextmanager
def stoppable(name: str, speaks: Callable[[], bool] = lambda: True) -> Iterator[None]:
    """End the process at once on Ctrl-C in here, with a sentence that the program's name begins, if it may print: for imports,
    which an exception leaves half done. They are `unswept`."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may set handlers, and only it is interrupted
        return

    def end(number: int, frame: Any) -> None:
        if speaks():
            os.write(2, f"{name}: stopped by the user\n".encode())
        os._exit(EXIT_STOPPED)

    before = signal.signal(signal.SIGINT, end)
    try:
        with unswept():
            yield
    finally:
        signal.signal(signal.SIGINT, before)


ALL_PICTURES, DEFAULT_OPTIONS = DrawingOptions(), RunOptions()


@contextlib.contextmanager
def asked_to_stop(waits: bool = False, speaks: bool = True) -> Iterator[Callable[[], bool]]:
    """Provide whether Ctrl-C or SIGTERM came in here, to be asked at moments that suit; a second one ends the process at once.

    For a command, whose process it is; a library's caller has handlers of their own. A process that ``waits`` for others in
    compiled code is killed where it cannot be asked for some time, with a sentence if it ``speaks``.
    """
    received: list[int] = []

    def note(number: int, frame: Any) -> None:
        if received:
            os._exit(EXIT_STOPPED)
        received.append(number)

    before = {number: signal.signal(number, note) for number in STOP_SIGNALS}
    guarded = processes.ended_after_signal(BLOCKED if speaks else "") if waits else contextlib.nullcontext()
    try:
        with guarded:
            yield lambda: bool(received)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def written(tell: Callable[[str], Any]) -> Iterator[None]:
    """Exit with `EXIT_FAILED`, and a sentence to ``tell``, where something cannot be written in here, standard output among it;
    without one where a reader has gone (a pipe to ``head``)."""
    try:
        try:
            yield
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()  # else Python finds out after the last line of the program
    except BrokenPipeError:
        _give_up_output()
        sys.exit(EXIT_FAILED)
    except OSError as error:
        _give_up_output()
        what = f"{error.filename} cannot be read or written" if error.filename else "the output cannot be written"
        with contextlib.suppress(OSError):
            tell(f"{what} ({error.strerror or error})")
        sys.exit(EXIT_FAILED)


def _give_up_output() -> None:
    """Discard the buffer's contents, so that the end of the program does not fail on them again."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        sys.stdout.flush()
    with contextlib.suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


CASE_SUFFIXES = (".toml", ".step", ".stp", ".msh", ".inp", ".vtk", ".vtu", ".stl", ".obj", ".ply", ".3mf")
"""File endings of cases, drawings and meshes."""


def usage_sentence(error: click.ClickException) -> str:
    """Return the sentence of a usage error, with the option that may have been meant."""
    if not isinstance(error, click.NoSuchOption) or error.ctx is None:
        return error.format_message()
    known = (name for param in error.ctx.command.params for name in param.opts if isinstance(param, click.Option))
    return f"there is no option {error.option_name}{errors.meant(error.option_name, known)}"


class CommandGroup(click.Group):
    """A group that answers a misspelt command with the one that may have been meant."""

    def resolve_command(self, ctx: click.Context, args: list[str]) -> tuple[str | None, click.Command | None, list[str]]:
        name, known = args[0], self.list_commands(ctx)
        if name.lower().endswith(CASE_SUFFIXES) and "run" in known:
            raise click.UsageError(f"{name!r} is not a command; did you mean softmodels run {name}?", ctx)
        if not name.startswith("-") and self.get_command(ctx, name) is None:
            near = errors.meant(name, known) or f"; there are {', '.join(known)}"
            raise click.UsageError(f"there is no command {name!r}{near}", ctx)
        return super().resolve_command(ctx, args)


class LazyGroup(CommandGroup):
    """A group that imports the module of a command when it is called; ``places`` has this module and the first sentence of its
    help, by the heading under which help lists it and its name. ``speaks`` says whether this process of the ``program`` may
    print, where it is stopped during an import."""

    def __init__(
        self,
        *,
        program: str,
        places: Mapping[str, Mapping[str, tuple[str, str]]],
        speaks: Callable[[], bool] = lambda: True,
        **given: Any,
    ):
        super().__init__(**given)
        self.program, self.places, self.speaks = program, places, speaks
        self.module_of = {name: module for group in places.values() for name, (module, _) in group.items()}

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.module_of)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self.commands and cmd_name in self.module_of:
            with stoppable(self.program, self.speaks):
                module = importlib.import_module(self.module_of[cmd_name])
            for command in vars(module).values():
                if isinstance(command, click.Command) and command.name == cmd_name:
                    self.add_command(command)
        return super().get_command(ctx, cmd_name)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands by group into the help, without importing them."""
        widest = max(map(len, self.module_of))
        for heading, group in self.places.items():
            with formatter.section(heading):
                formatter.write_dl([(name.ljust(widest), text) for name, (_, text) in group.items()])


version_option = click.version_option(version(), "-v", "--version", prog_name="softmodels")
"""``-v`` and ``--version``."""


def tell(sentence: str, program: str = "softmodels") -> None:
    """Print an error of a program to standard error; on a terminal its name is red, unless NO_COLOR is set."""
    text = processes.wrapped(f"{program}: {bounded(sentence)}", processes.columns("stderr"))
    if not os.environ.get("NO_COLOR") and sys.stderr.isatty() and os.environ.get("TERM") != "dumb":
        text = click.style(f"{program}:", fg="red", bold=True) + text.removeprefix(f"{program}:")
    print(text, file=sys.stderr, flush=True)


@contextlib.contextmanager
def ending(tell: Callable[[str], None] = tell) -> Iterator[None]:
    """Exit with a sentence and a status where a click command ends with an error in here: usage errors have status 2, Ctrl-C
    `EXIT_STOPPED`, output that has nowhere to go and missing memory 1."""
    with written(tell):
        try:
            yield
        except click.exceptions.NoArgsIsHelpError as error:
            print(error.format_message())
            sys.exit(EXIT_BAD_INPUT)
        except click.ClickException as error:
            missing = isinstance(error, click.MissingParameter)
            tell(_missing(error) if missing else f"{usage_sentence(error)} (see --help)")  # type: ignore[arg-type]
            sys.exit(error.exit_code)
        except (click.exceptions.Abort, KeyboardInterrupt):
            tell("stopped by the user")
            sys.exit(EXIT_STOPPED)
        except MemoryError:
            tell(
                "out of memory; close other programs, or reduce the problem (a smaller photograph, larger cells, fewer --jobs)"
            )
            sys.exit(EXIT_FAILED)


def _missing(error: click.MissingParameter) -> str:
    """Return a message for missing arguments, with the examples of the command's help."""
    context, said = error.ctx, error.format_message().rstrip(".")
    if context is None or context.command.help is None:
        return f"{said} (see --help)"
    lines = [" ".join(line.split()) for line in context.command.help.partition("Examples:")[2].splitlines()]
    examples = [line for line in lines if line.startswith("softmodels ")][:3]
    if not examples:
        return f"{said} (see {context.command_path} --help)"
    return f"{said}; for example: {' | '.join(examples)} (softmodels examples writes files to begin with; see --help)"


def run_command(command: click.Command, name: str) -> None:
    """Run a click command of this name and exit."""
    with ending():
        sys.exit(command.main(prog_name=name, standalone_mode=False))


# ----------------------------------------------------------------------------------------------------------------------
# What a command writes: a folder of results that is replaced whole at its end, and single files.
#
# Earlier results are replaced whole or stay. No file is written over one that is read, nor over one that somebody else made.


NO_INPUT = ("output", "quiet", "no_pictures", "jobs")
"""Options that change nothing in a command's numbers."""


class ResultFolder:
    """A command's folder of results, locked from its beginning to its end; `OwnFolderError` if it is not this program's, is in
    use, or cannot be written.

    Without ``output`` it is the first of ``default``, ``default-2`` ... that is free or holds results of the very same inputs:
    the command's options by name, and the files that are read, or folders of CSV files, which are never replaced.
    """

    def __init__(self, output: Path | None, default: Path, kind: str, options: Mapping[str, Any], files: Iterable[Path] = ()):
        files = list(files)
        self._inputs = {
            "options": {name: repr(value) for name, value in sorted(options.items()) if name not in NO_INPUT},
            "files": {str(file): fingerprint(file) for file in files},
        }
        try:
            if output is None:
                self._own = folders.take_default(default, kind, self._inputs)
            else:
                self._own = folders.OwnFolder(output, kind)
                self._own.take()
            try:
                self._own.check_inputs(files)
            except OwnFolderError:
                self._own.leave()
                raise
        except InUseError as error:
            raise OwnFolderError(str(error)) from None
        except OSError as error:
            raise OwnFolderError(f"the folder {output or default} cannot be written ({errors.reason(error)})") from None

    @property
    def path(self) -> Path:
        return self._own.path

    @property
    def is_done(self) -> bool:
        """Whether it holds the results of the very same inputs already."""
        record = self._own.record
        same = record is not None and record.about.get("inputs") == self._inputs
        return same and all((self.path / name).exists() for name in self._own.files)

    @contextlib.contextmanager
    def writing(self) -> Iterator[Path]:
        """Provide a folder to write all results into, which take the place of the earlier ones at the end of the block;
        `OwnFolderError` if somebody else's file has the name of a result. Without room the earlier results stay."""
        yield self._own.prepare()
        self._own.bring_in({"inputs": self._inputs, "made": Provenance.now().table()})

    def leave(self) -> None:
        """Let go of it; nothing is left where nothing was written."""
        self._own.leave()


def open_folder(
    output: Path | None, default: Path, kind: str, options: Mapping[str, Any], files: Iterable[Path] = ()
) -> ResultFolder:
    """Return a `ResultFolder` that is let go of when the command ends, however it ends."""
    folder = ResultFolder(output, default, kind, options, files)
    click.get_current_context().call_on_close(folder.leave)
    return folder


def open_place(output: Path | None, default: Path, kind: str, names: Iterable[str]) -> Path:
    """Return a folder for what several commands write one after the other, locked until the running command ends.

    Without ``output`` it is the first of ``default``, ``default-2`` ... that is free or of this kind. ``names`` are all that
    is written there; folders with a slash at the end. `OwnFolderError` if it is not this program's, is in use, or holds
    somebody else's files of these names.
    """
    try:
        own = folders.take_default(default, kind, {}) if output is None else folders.OwnFolder(output, kind)
        own.take()
    except InUseError as error:
        raise OwnFolderError(str(error)) from None
    click.get_current_context().call_on_close(own.leave)
    own.claim(names, {"inputs": {}})
    return own.path


def check_output_file(path: Path, inputs: Iterable[Path], is_own: Callable[[Path], bool], what: str, option: str) -> None:
    """Raise `OwnFolderError`, which names the option, if a file would take the place of an input, or of one that is not an
    earlier one of its kind, ``what`` in words."""
    for file in inputs:
        if is_same(path, file):
            raise OwnFolderError(f"{path} is an input and would be overwritten by {what}; give another name ({option})")
    if path.is_dir():
        raise OwnFolderError(f"{path} is a folder; name a file for {what} ({option})")
    if path.exists() and not is_own(path):
        raise OwnFolderError(
            f"{path} exists and is not {what} of this program, so it is not replaced; give another name ({option}), or "
            "move it away"
        )


# ----------------------------------------------------------------------------------------------------------------------
# Where results are to go: asked before the work begins, so that nobody waits for what cannot be kept.


DISK_FULL_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of a disk without room: the run failed, its input was good."""


def trouble(folder: Path) -> str:
    """Return why files cannot be written into a folder, which need not exist yet; empty if they can."""
    place = Path(folder)
    try:
        while not place.exists():
            place = place.parent
        if not place.is_dir():
            return os.strerror(errno.ENOTDIR)
        return "" if os.access(place, os.W_OK | os.X_OK) else os.strerror(errno.EACCES)
    except (OSError, ValueError) as error:
        return getattr(error, "strerror", None) or str(error)


def status_of(error: OSError) -> int:
    """Exit status where something could not be written: the place was bad input, or the disk became full."""
    return EXIT_FAILED if error.errno in DISK_FULL_ERRORS else EXIT_BAD_INPUT


# ----------------------------------------------------------------------------------------------------------------------
# Where results come from, and the numbers of a page.


_STARTED = time.monotonic()


@functools.cache
def commit() -> str:
    """Return the commit of the checkout that runs, with ``+`` if files differ from it; empty where there is none."""
    top = Path(__file__).parents[2]
    if not (top / ".git").exists():
        return ""
    words = ["git", "-C", str(top), "describe", "--always", "--exclude=*", "--abbrev=12", "--dirty=+"]
    with contextlib.suppress(OSError, subprocess.SubprocessError):
        done = subprocess.run(words, capture_output=True, text=True, timeout=5, check=False)
        return done.stdout.strip() if done.returncode == 0 else ""
    return ""


def command_line() -> str:
    """Return the command that runs, as it can be pasted; empty in a Python program."""
    context = click.get_current_context(silent=True)
    name = context.find_root().info_name if context else None
    return shlex.join([*name.split(), *sys.argv[1:]]) if name else ""


def _libraries() -> dict[str, str]:
    """Return the versions of DOLFINx and PETSc if they were used; nothing is imported for it."""
    libraries = {}
    if (dolfinx := sys.modules.get("dolfinx")) is not None:
        libraries["DOLFINx"] = str(getattr(dolfinx, "__version__", "unknown"))
    if (PETSc := sys.modules.get("petsc4py.PETSc")) is not None:
        libraries["PETSc"] = ".".join(map(str, PETSc.Sys.getVersion()))
    return libraries


@dataclasses.dataclass(frozen=True)
class Provenance:
    """Where results come from; empty texts where that is unknown: date (UTC), version and commit of softmodels, versions of
    DOLFINx and PETSc if they were used, how many seconds it took, and the command that made them."""

    date: str = ""
    version: str = ""
    commit: str = ""
    libraries: Mapping[str, str] = dataclasses.field(default_factory=dict)
    seconds: float | None = None
    command: str = ""

    @classmethod
    def now(cls, seconds: float | None = None) -> Provenance:
        """Return that of results made now; a command's time counts from the start of its process unless given."""
        command = command_line()
        if seconds is None and command:
            seconds = time.monotonic() - _STARTED
        date = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")
        return cls(date, version(), commit(), _libraries(), None if seconds is None else round(seconds, 1), command)

    @classmethod
    def from_table(cls, table: object) -> Provenance:
        """Return that of a folder's record; unknown where the record has none, or another's."""
        given = table if isinstance(table, dict) else {}
        texts = {name: value for name in ("date", "version", "commit", "command") if isinstance(value := given.get(name), str)}
        libraries, seconds = given.get("libraries"), given.get("seconds")
        return cls(
            **texts,
            libraries={str(k): str(v) for k, v in libraries.items()} if isinstance(libraries, dict) else {},
            seconds=float(seconds) if isinstance(seconds, int | float) else None,
        )

    def table(self) -> dict[str, Any]:
        """Return it for a folder's record."""
        return dataclasses.asdict(self)

    @property
    def rows(self) -> list[tuple[str, str]]:
        """What is known of it: names and texts."""
        program = f"softmodels {self.version}" if self.version else ""
        if program and self.commit:
            edited = ", with local changes" if self.commit.endswith("+") else ""
            program += f", commit {self.commit.removesuffix('+')}{edited}"
        time_taken = "" if self.seconds is None else f"{self.seconds:.1f} s"
        libraries = ", ".join(f"{name} {version}" for name, version in self.libraries.items())
        rows = [("date", self.date), ("program", program), ("libraries", libraries), ("wall time", time_taken),
                ("command", self.command)]  # fmt: skip
        return [row for row in rows if row[1]] or [("origin", "not recorded in this folder")]

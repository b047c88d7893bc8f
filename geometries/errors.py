"""What can go wrong with a geometry: parameters that make no device, a mesher that gives up, a file that is no mesh."""

from pathlib import Path

from measurement.wording import Spoken


class FieldError(Spoken, ValueError):
    """A value that its field cannot take, or an entry that no field has; the message is a sentence for the user."""


def whole_path(file: str) -> str:
    """A file's path from wherever the program goes later; what cannot be one stays as it is, for who reads it to refuse."""
    try:
        return str(Path(file).absolute()) if file and "\0" not in file else file
    except OSError:  # the current folder is gone
        return file


class GeometryError(Spoken, ValueError):
    """Parameters that make no device; the message is a sentence for the user naming the field and its value."""


class MeshingError(Spoken, RuntimeError):
    """The mesher failed on parameters that look possible; the message says what failed and what to try."""


class MeshingStopped(Exception):
    """The caller asked for an end while a mesh was being made."""


class MeshFileError(Spoken, ValueError):
    """A file that is not a mesh as this project writes them; the message is a sentence for the user naming the file."""

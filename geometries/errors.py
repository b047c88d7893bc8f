"""What can go wrong with a geometry: parameters that make no device, and a mesher that gives up."""


class GeometryError(ValueError):
    """Parameters that make no device; the message is a sentence for the user naming the field and its value."""


class MeshingError(RuntimeError):
    """The mesher failed on parameters that look possible; the message says what failed and what to try."""

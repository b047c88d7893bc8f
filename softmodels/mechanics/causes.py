"""Why a device has no state of rest beyond some state, where that is its own doing and no limit point of what drives it."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class Cause:
    """One such reason.

    Attributes:
        clause: What happens there.
        advice: What can be done, a sentence without its full stop.
        of_mesh: Whether it is the mesh's, and the device may well go on: no limit of the device is known then.
    """

    clause: str
    advice: str
    of_mesh: bool = False

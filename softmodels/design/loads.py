"""At which states a design is judged: at a pressure, or at an added volume where pressures alone do not tell states apart."""

from __future__ import annotations

import dataclasses

from measurement.units import readable

PRESSURE, VOLUME = "pressure", "volume"


@dataclasses.dataclass(frozen=True, order=True)
class Load:
    """A state of a device by its load.

    Attributes:
        kind: "pressure" (the first state at that pressure) or "volume" (added to the cavity of the whole device).
        value: Pa or m3.
        text: How the user wrote it, such as "30 kPa" or "177 cm"; empty where it was a number.
    """

    kind: str
    value: float
    text: str = dataclasses.field(default="", compare=False)

    def __post_init__(self) -> None:
        if self.kind not in (PRESSURE, VOLUME):
            raise ValueError(f"load {self.kind!r} is not one of {PRESSURE}, {VOLUME}")

    @classmethod
    def of(cls, value: float | Load) -> Load:
        """A load as it is; a number is a pressure in Pa."""
        return value if isinstance(value, Load) else cls(PRESSURE, float(value))

    def __str__(self) -> str:
        return (
            readable(self.value, "Pa" if self.kind == PRESSURE else "ml")
            if self.kind == PRESSURE
            else f"{self.value * 1e6:.6g} ml"
        )

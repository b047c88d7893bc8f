"""How laws are fitted, as one value: what the command line's options and a library call's keywords become."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from types import MappingProxyType

from geometries.errors import FieldError
from geometries.kinds import Flag, Kind, Quantity, Several, Words
from measurement import wording
from measurement.arguments import checked
from measurement.units import brief
from measurement.wording import meant
from softmodels.fitting.problem import Changes, FitError

for _option, _argument in (("fix", "FitOptions.changes of"), ("untrusted", "FitOptions(untrusted=True)")):
    wording.call(_option, _argument)
wording.call("gauge-error", "FitOptions.gauge_error")

BENCH = ("pressure_offset", "pressure_scale", "leak", "scale", "zero", "centre")
"""Parameters of the bench."""

SECTION_ERROR, LOAD_CELL_ERROR = 0.03, 0.01
"""Standard errors, as shares, that a test's stress has as a whole unless somebody knows better. The cross-section: ISO 37 lets
the thickness of one dumb-bell vary by 2 % and measures its width to 0.05 mm, 1 % of it; cast strips are no better. The load
cell: class 1 of ISO 7500-1."""
USUAL_GAUGE_ERROR = math.hypot(SECTION_ERROR, LOAD_CELL_ERROR)
"""What they make together."""

HEIGHTS_FROM = ("shadow", "apex", "undeformed")
"""What heights of a device that hangs under loads may count from: the upper edge of its shadow at zero pressure, its apex
there, or its undeformed top."""


@checked
@dataclasses.dataclass(frozen=True)
class FitOptions:
    """How laws are fitted.

    Attributes:
        poisson: Poisson's ratio of the fitted material, given and not fitted (but see ``free``).
        changes: Bounds, priors, starts and fixed values by parameter, see `softmodels.fitting.problem.Changes`; in SI units.
        robust: Whether outliers count by their size, not by its square.
        profiles: Whether the intervals come from profile likelihoods; else from the covariance.
        silicone: Name of the silicone, whose known moduli show pressures in a wrong unit; ``"any"`` if it is in no list.
        stress_error: Standard error of stresses, see `softmodels.fitting.curves.stress_error.StressError.from_text`.
        gauge_error: Standard error of a factor on each test (cross-section, load cell), a share; 0 for none. A curve alone says
            nothing of such a factor, so the intervals are too narrow without it.
        free: With a device: what is fitted of bench and device beside the law, see `softmodels.fitting.outlines.bench.Bench`.
        without: With a device: names of photographs that are left out.
        untrusted: With a device: whether measurements are taken that the measurement does not trust.
        heights_from: With a device that hangs under loads or whose top is not flat: what its heights count from, one of
            `HEIGHTS_FROM`; empty for the shadow, or the apex where the undeformed top is not flat. Outlines of
            such a top (balloon, bellows) have to state it.
    """

    poisson: float = 0.5
    changes: Changes = dataclasses.field(default_factory=lambda: MappingProxyType({}))
    robust: bool = False
    profiles: bool = True
    silicone: str | None = None
    stress_error: str = "auto"
    gauge_error: float = USUAL_GAUGE_ERROR
    free: tuple[str, ...] = BENCH
    without: tuple[str, ...] = ()
    untrusted: bool = False
    heights_from: str = ""

    def __post_init__(self) -> None:
        texts = Several(Words())
        kinds: dict[str, Kind] = {
            "poisson": Quantity(), "gauge_error": Quantity(), "robust": Flag(), "profiles": Flag(), "untrusted": Flag(),
            "stress_error": Words(), "heights_from": Words(), "free": texts, "without": texts,
        }  # fmt: skip
        for name, kind in kinds.items():
            value = getattr(self, name)
            try:
                settled = kind.settled(name, (value,) if kind is texts and isinstance(value, str) else value)
            except FieldError as error:
                raise FitError(str(error)) from None
            object.__setattr__(self, name, settled)
        if not isinstance(self.silicone, str | None):
            raise FitError(f"silicone is {brief(self.silicone)}; it must be the name of one, such as 'ecoflex-00-30'")
        if not isinstance(self.changes, Mapping) or not all(isinstance(one, Mapping) for one in self.changes.values()):
            raise FitError(
                f"changes is {brief(self.changes)}; it must be a table by parameter, such as {{'c1': {{'value': 14e3}}}}"
            )
        if self.heights_from not in ("", *HEIGHTS_FROM):
            known = f"{', '.join(HEIGHTS_FROM)}{meant(self.heights_from, HEIGHTS_FROM)}"
            raise FitError(f"heights_from is {self.heights_from!r}; it is one of {known}")
        if not 0.0 <= self.gauge_error < 1.0:
            raise FitError(f"a gauge error of {self.gauge_error:g} is not a share between 0 and 100 %")

    @property
    def gauge_words(self) -> str:
        """The factor on each test, a clause begun with a comma."""
        if not self.gauge_error:
            return ", no factor on the tests (--gauge-error): the intervals leave the errors of cross-section and load cell out"
        usual = ""
        if self.gauge_error == USUAL_GAUGE_ERROR:
            usual = (
                f" (cross-section {100 * SECTION_ERROR:g} % and load cell {100 * LOAD_CELL_ERROR:g} %, as is usual; "
                "--gauge-error gives others)"
            )
        return f", a factor of 1 +- {100 * self.gauge_error:.3g} % on each test{usual}"

    @property
    def loss(self) -> str:
        """See `softmodels.fitting.least_squares.fit_parameters`."""
        return "soft_l1" if self.robust else "linear"

    def changes_of(self, names: tuple[str, ...]) -> Changes:
        """The changes that are about these parameters."""
        return {name: change for name, change in self.changes.items() if name in names}


DEFAULTS = FitOptions()

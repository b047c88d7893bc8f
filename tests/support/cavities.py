"""Bodies whose pressure works on another volume than that of a closed cavity."""

from __future__ import annotations

import ufl

from softmodels.mechanics.body import Body


class TubeBody(Body):
    """A body whose cavity is open at a plane that does not hold the origin, as that of a slice of a tube is.

    The library's volume integral leaves out what the plane at the top would add. Between two planes square to z the
    horizontal part of x alone gives the volume, div (x, y, 0) / 2 = 1, and the planes add nothing to it.
    """

    def volume_integrand(self, w):
        F, N = self.deformation_gradient(w), ufl.FacetNormal(self.mesh)
        x = ufl.SpatialCoordinate(self.mesh) + self.displacement(w)
        flat = ufl.as_vector([x[0], 0, 0] if self.axisymmetric else [x[0], x[1], 0])
        N = ufl.as_vector([N[0], 0, N[1]]) if self.axisymmetric else N
        return -ufl.dot(flat, ufl.dot(ufl.cofac(F), N)) / 2 * self.hoop


class OutsideBody(TubeBody):
    """A tube under pressure from outside: its "cavity" is the outer face, and the volume what the tube gives up.

    Twice the undeformed volume is added, so that it is one at rest, as a cavity's is, and rises under pressure.
    """

    def volume_integrand(self, w):
        X, N = ufl.SpatialCoordinate(self.mesh), ufl.FacetNormal(self.mesh)
        return super().volume_integrand(w) + X[0] * N[0] + X[1] * N[1]


class PushedBody(Body):
    """The platen is a piston: the volume that the pressure works on is the room behind it."""

    def volume_integrand(self, w):
        return (ufl.SpatialCoordinate(self.mesh) - self.displacement(w))[0]

"""The lights of rendered pictures, and how they shade a surface.

VTK works out a gloss for each light and each pixel, which takes nearly half of a picture's time where there is no graphics
card. Nothing here is glossy, and without the gloss every pixel comes out the same.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pyvista import Actor, Plotter

HEADLIGHT, LAMP = 0.5, 0.35
"""Intensities of a light at the viewer, and of another one."""
LAMP_PLACE = (-0.4, 1.0, 0.3)
"""From where the other one shines: to the right, upwards, towards the viewer."""
SHADING = """
  float facing = max(0.0, normalVCVSOutput.z);
  float lit = max(0.0, dot(normalVCVSOutput, vec3({:.9f}, {:.9f}, {:.9f})));
  gl_FragData[0] = vec4(ambientColor + diffuseColor * ({:.9f} * facing + {:.9f} * lit), opacity);
"""
"""In VTK's own names, for parallel projection."""


def add_lights(plotter: Plotter) -> None:
    """The lights as VTK's own: what `shade` has not been called for is shaded by these."""
    import pyvista

    plotter.add_light(pyvista.Light(light_type="headlight", intensity=HEADLIGHT))
    plotter.add_light(pyvista.Light(light_type="camera light", position=LAMP_PLACE, intensity=LAMP))


def shade(actor: Actor) -> None:
    """Shade a surface by the lights, without a gloss."""
    lamp = np.array(LAMP_PLACE) / np.linalg.norm(LAMP_PLACE)
    code = SHADING.format(*lamp, HEADLIGHT, LAMP)
    actor.GetShaderProperty().AddFragmentShaderReplacement("//VTK::Light::Impl", True, code, False)

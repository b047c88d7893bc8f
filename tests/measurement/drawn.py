"""Boards drawn through the photographer's truth, for tests."""

from __future__ import annotations

import numpy as np
from scipy.special import erf

from measurement.synthetic import truth_of


def chessboard(scene, squares=(10, 7), side=0.008, blur=0.8, noise=0.0, seed=0):
    truth = truth_of(scene)
    y, x = np.indices((scene.height, scene.width)).astype(float)
    px = np.column_stack([x.ravel(), y.ravel()])
    place = truth.to_screen(px) / side
    beside = [truth.to_screen(px + step) / side - place for step in np.eye(2)]
    wave, inside = [], 1.0
    for axis in (0, 1):
        half = squares[axis] / 2
        at = place[:, axis] + half
        width = np.hypot(beside[0][:, axis], beside[1][:, axis]) * np.hypot(blur, 0.29) * np.sqrt(2)
        line = np.rint(at)
        wave.append(erf((at - line) / width) * (1 - 2 * (line % 2)))
        inside = inside * 0.5 * (erf(at / width) - erf((at - 2 * half) / width))
    light = 220.0 - inside * 90.0 * (1.0 + wave[0] * wave[1])
    light = light + noise * np.random.default_rng(seed).normal(size=light.shape)
    image = np.clip(np.rint(light), 0, 255).astype(np.uint8).reshape(scene.height, scene.width)
    return np.repeat(image[..., None], 3, axis=2)
